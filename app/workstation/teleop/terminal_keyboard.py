"""The keyboard of a plain terminal as a source; works over SSH.

A terminal tells of keys that go down, and of repetitions while they are held, but never of keys that come up. So a key
counts as held for a while after it was last heard of. It only repeats the newest key: diagonals have keys of their own.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from layflat.app.workstation.teleop import key_map
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.app.workstation.teleop.terminal_keys import TerminalKeys
from layflat.data.robot import RobotSpec

TAP_S = 0.3
"""A key that is pressed counts as held for so long: three steps, 3 cm at the first speed."""
REPEAT_S = 0.2
"""The same of a key that repeats, which terminals do 10 to 30 times a second."""
SAME_PRESS_S = 0.8
"""A key heard of again within this time may be repeating: the first repetition comes after 0.25 to 0.7 s."""


class TerminalKeyboard:
    """Made, it takes the terminal; ``close`` gives it back."""

    name = "keyboard"

    def __init__(
        self,
        robot: RobotSpec,
        *,
        left: int = 2,
        pressed: Callable[[], list[str]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """``pressed`` gives the names of keys since its last call, for tests; else the terminal does."""
        self.robot: RobotSpec = robot
        self._moves = key_map.key_motions(robot, left=left)
        self._clock = clock
        self._terminal = TerminalKeys() if pressed is None else None
        self._pressed = self._terminal.pressed if self._terminal is not None else pressed
        self._held_until: dict[str, float] = {}
        self._heard: dict[str, float] = {}
        self._speed = key_map.SPEED

    def poll(self) -> TeleopInput:
        now = self._clock()
        controls = []
        for key in self._pressed() if self._pressed is not None else []:
            if key in key_map.CONTROLS:
                controls.append(key_map.CONTROLS[key])
            elif key in key_map.SPEEDS:
                self._speed = key_map.SPEEDS[key]
            elif key in self._moves:
                self._hear(key, now)
        if self._terminal is not None and self._terminal.gone:
            controls.append(Command.QUIT)
        held = [key for key, until in self._held_until.items() if now < until]
        return TeleopInput(
            motion=key_map.sum_motions(self.robot, self._moves, held),
            speed=self._speed,
            controls=tuple(controls),
            device="terminal",
        )

    def rumble(self, strength: float, seconds: float) -> None:
        """Keyboards do not."""

    def help(self) -> tuple[Button, ...]:
        return key_map.help_of(self.robot)

    def close(self) -> None:
        if self._terminal is not None:
            self._terminal.close()

    def _hear(self, key: str, now: float) -> None:
        repeats = now - self._heard.get(key, -np.inf) < SAME_PRESS_S
        self._heard[key] = now
        # What moves against the new key has been let go.
        against = [other for other in self._held_until if self._moves[other] @ self._moves[key] < 0]
        for other in against:
            del self._held_until[other]
        self._held_until[key] = now + (REPEAT_S if repeats else TAP_S)
