"""Keyboard of a plain terminal; works over SSH.

A terminal reports keys that go down and repetitions while they are held, but never keys that come up. So a key counts
as held for a while after it was last reported. Only the newest key repeats: diagonals have keys of their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from layflat.app.workstation.teleop import key_map
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, Teleoperator
from layflat.app.workstation.teleop.terminal_keys import TerminalKeys
from layflat.data.robot import RobotSpec

TAP_S = 0.3
"""Time for which a pressed key counts as held: three steps, 3 cm at the first speed."""
REPEAT_S = 0.2
"""The same for a key that repeats, which terminals do 10 to 30 times a second."""
SAME_PRESS_S = 0.8
"""A key reported again within this time may be repeating: the first repetition comes after 0.25 to 0.7 s."""


class TerminalKeyboard(Teleoperator):
    """Teleoperator that takes over the terminal until `close`."""

    name = "keyboard"

    def __init__(
        self,
        robot: RobotSpec,
        *,
        pressed: Callable[[], list[str]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Read keys from the terminal, or from ``pressed``, which returns those since its last call."""
        self.robot: RobotSpec = robot
        self._motions = key_map.key_motions(robot)
        self._clock = clock
        self._terminal = TerminalKeys() if pressed is None else None
        self._pressed = pressed
        self._held_until: dict[str, float] = {}
        self._reported: dict[str, float] = {}
        self._speed = key_map.SPEED

    def poll(self) -> TeleopInput:
        """Return the motion of the held keys and the commands since the last poll."""
        now = self._clock()
        commands = []
        pressed = self._terminal.pressed() if self._terminal is not None else self._pressed() if self._pressed else []
        for key in pressed:
            if key in key_map.COMMANDS:
                commands.append(key_map.COMMANDS[key])
            elif key in key_map.SPEEDS:
                self._speed = key_map.SPEEDS[key]
            elif key in self._motions:
                self._hold(key, now)
        if self._terminal is not None and self._terminal.gone:
            commands.append(Command.QUIT)
        resumed = self._terminal is not None and self._terminal.resumed
        if self._terminal is not None and resumed:
            self._terminal.resumed = False
            self._held_until.clear()  # Released meanwhile.
        held = [key for key, until in self._held_until.items() if now < until]
        return TeleopInput(
            motion=key_map.sum_motions(self.robot, self._motions, held),
            speed=self._speed,
            commands=tuple(commands),
            device="terminal",
            connected=not resumed,
            problem="the program was stopped" if resumed else "",
        )

    def help(self) -> tuple[Button, ...]:
        """Return the effect of each key."""
        return key_map.key_help(self.robot)

    def close(self) -> None:
        """Restore the terminal."""
        if self._terminal is not None:
            self._terminal.close()

    def _hold(self, key: str, now: float) -> None:
        repeats = now - self._reported.get(key, -math.inf) < SAME_PRESS_S
        self._reported[key] = now
        # Keys that move against the new one have been released.
        opposite = [other for other in self._held_until if self._motions[other] @ self._motions[key] < 0]
        for other in opposite:
            del self._held_until[other]
        self._held_until[key] = now + (REPEAT_S if repeats else TAP_S)
