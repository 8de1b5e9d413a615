"""Keyboards: the same keys in the window, where several may be held together, and in a plain terminal, also over SSH.

Names of keys are such as ``a``, ``A``, ``shift-left``, ``enter``. A terminal reports keys that go down and repetitions
while they are held, but never keys that come up, so there a key counts as held for a while after it was last reported.
Only the newest key repeats: diagonals have keys of their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, Teleoperator, WindowTeleoperator
from layflat.app.workstation.teleop.terminal_keys import TerminalKeys
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

LEFT, RIGHT = 1, 0
"""Point of a robot with two points that is on the left and on the right of the person in the window's first view: that
looks along +x, and point 1 is at -y. To the person's right is +y."""
COMMANDS: Mapping[str, Command] = {
    "enter": Command.START,
    "space": Command.PAUSE,
    "y": Command.KEEP_SUCCESS,
    "n": Command.KEEP_FAILURE,
    "x": Command.DISCARD,
    "r": Command.REDO,
    "u": Command.UNDO,
    "b": Command.DISTURB,
    "q": Command.QUIT,
}
LABELS = {"enter": "Enter", "space": "Space"}
SPEED = 0.5
SPEEDS = {str(digit): digit / 10 if digit else 1.0 for digit in range(10)}
WINDOW_TAP_S = 1.0
"""Time in which a key that is up again acts on a step; one that comes while nothing steps must not act later."""
TAP_S = 0.3
"""Time for which a pressed key of a terminal counts as held: three steps, 3 cm at the first speed."""
REPEAT_S = 0.2
"""The same for a key that repeats, which terminals do 10 to 30 times a second."""
SAME_PRESS_S = 0.8
"""A key reported again within this time may be repeating: the first repetition comes after 0.25 to 0.7 s."""
_DIAGONALS = "up and forward, down and forward, down and back"
_MOTION_HELP: Mapping[int, tuple[Button, ...]] = {
    1: (Button("arrows, w a s d", "up, back, down, forward"), Button("e c z", _DIAGONALS)),
    2: (
        Button("w a s d", "left picker up, back, down, forward; A D to the left, to the right"),
        Button("i j k l", "right picker likewise; J L to the left, to the right"),
        Button("arrows", "both; with shift to the left, to the right"),
        Button("e c z", f"both, {_DIAGONALS}"),
    ),
}


def _directions(*keys: str) -> dict[str, tuple[int, int, int]]:
    """Return x, y, z of keys: back, forward, up, down, to the left, to the right."""
    ways = ((-1, 0, 0), (1, 0, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (0, 1, 0))
    return dict(zip(keys, ways, strict=True))


_ARROWS = ("left", "right", "up", "down")
_BOTH = _directions(*_ARROWS, "shift-left", "shift-right") | {"e": (1, 0, 1), "c": (1, 0, -1), "z": (-1, 0, -1)}
_LEFT_POINT, _RIGHT_POINT = _directions(*"adwsAD"), _directions(*"jlikJL")


def key_motions(robot: RobotSpec) -> dict[str, FloatArray]:
    """Return the motion (A,) of each key that moves the robot."""
    if robot.n_points == 1:
        packed = {key: robot.pack(direction) for key, direction in (_BOTH | _LEFT_POINT).items()}
        return {key: motion for key, motion in packed.items() if motion.any()}
    found = {}
    for points, directions in (([LEFT], _LEFT_POINT), ([RIGHT], _RIGHT_POINT), ([LEFT, RIGHT], _BOTH)):
        for key, direction in directions.items():
            pair = np.zeros((2, 3))
            pair[points] = direction
            found[key] = robot.pack(pair)
    return found


def key_help(robot: RobotSpec) -> tuple[Button, ...]:
    """Return the effect of each key."""
    commands = (Button(LABELS.get(key, key), command.value, command) for key, command in COMMANDS.items())
    return (*_MOTION_HELP[robot.n_points], Button("1..9 0", "speed: 5 at first, 0 is the fastest"), *commands)


class _Keys:
    """Motions, speed and commands of keys."""

    name = "keyboard"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot: RobotSpec = robot
        self._motions = key_motions(robot)
        self._commands: list[Command] = []
        self._speed = SPEED

    def help(self) -> tuple[Button, ...]:
        """Return the effect of each key."""
        return key_help(self.robot)

    def _press(self, key: str) -> bool:
        """Note a command or a speed; return whether the key is one."""
        if key in COMMANDS:
            self._commands.append(COMMANDS[key])
        self._speed = SPEEDS.get(key, self._speed)
        return key in COMMANDS or key in SPEEDS

    def _input(self, held: Iterable[str], **others: Any) -> TeleopInput:
        """Return the motion of keys held together, and the commands since the last call."""
        commands, self._commands = tuple(self._commands), []
        motion = np.clip(sum((self._motions[key] for key in held), self.robot.zeros()), -1.0, 1.0)
        return TeleopInput(motion=motion, speed=self._speed, commands=commands, **others)


class WindowKeyboard(_Keys, WindowTeleoperator):
    """Teleoperator of key events; held keys are released when the window loses the focus."""

    def __init__(self, robot: RobotSpec) -> None:
        super().__init__(robot)
        self._pygame = sdl.load()
        self._held: dict[int, str] = {}
        """Name of each held key when it was pressed, by pygame's code: releasing shift first must not leave it held."""
        self._taps: dict[str, float] = {}
        """When each motion key was pressed that no step has acted on yet, s of the monotonic clock."""

    def on_event(self, event: Any) -> bool:
        """Handle key presses and releases; leave shortcuts with Ctrl, Alt and Meta to the window."""
        pygame = self._pygame
        if event.type == pygame.WINDOWFOCUSLOST:
            self.close()
        if event.type == pygame.KEYUP:
            return self._held.pop(event.key, None) is not None
        if event.type != pygame.KEYDOWN or event.mod & (pygame.KMOD_CTRL | pygame.KMOD_ALT | pygame.KMOD_META):
            return False
        name = self._key_name(event)
        if name in self._motions:
            self._held[event.key], self._taps[name] = name, time.monotonic()
        return name in self._motions or self._press(name)

    def poll(self) -> TeleopInput:
        """Return the motion of the held keys and the commands since the last poll."""
        self.release_taps(time.monotonic() - WINDOW_TAP_S)
        return self._input({*self._held.values(), *self._taps}, device="keyboard")

    def release_taps(self, acted_s: float) -> None:
        """Forget the taps before the input of ``acted_s``, on which a step has acted: each tap acts for a step."""
        self._taps = {name: at_s for name, at_s in self._taps.items() if at_s >= acted_s}

    def close(self) -> None:
        """Release all keys."""
        self._held.clear()
        self._taps.clear()

    def _key_name(self, event: Any) -> str:
        """Return the name that the terminal uses for this key."""
        pygame = self._pygame
        name = "enter" if event.key == pygame.K_KP_ENTER else str(pygame.key.name(event.key)).replace("return", "enter")
        if not event.mod & pygame.KMOD_SHIFT:
            return name
        return f"shift-{name}" if name in _ARROWS else name.upper() if len(name) == 1 else name


class TerminalKeyboard(_Keys, Teleoperator):
    """Teleoperator that takes over the terminal until `close`."""

    def __init__(
        self,
        robot: RobotSpec,
        *,
        pressed: Callable[[], list[str]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Read keys from the terminal, or from ``pressed``, which returns those since its last call."""
        super().__init__(robot)
        self._clock = clock
        self._terminal = TerminalKeys() if pressed is None else None
        self._pressed = pressed or (self._terminal.pressed if self._terminal else list)
        self._held_until: dict[str, float] = {}
        self._reported: dict[str, float] = {}

    def poll(self) -> TeleopInput:
        """Return the motion of the held keys and the commands since the last poll."""
        now, terminal, resumed = self._clock(), self._terminal, False
        for key in self._pressed():
            if not self._press(key) and key in self._motions:
                self._hold(key, now)
        if terminal is not None:
            self._commands += [Command.QUIT] * terminal.gone
            resumed, terminal.resumed = terminal.resumed, False
        if resumed:
            self._held_until.clear()  # Released meanwhile.
        held = [key for key, until in self._held_until.items() if now < until]
        problem = "the program was stopped" if resumed else ""
        return self._input(held, device="terminal", connected=not resumed, problem=problem)

    def close(self) -> None:
        """Restore the terminal."""
        if self._terminal is not None:
            self._terminal.close()

    def _hold(self, key: str, now: float) -> None:
        repeats = now - self._reported.get(key, -math.inf) < SAME_PRESS_S
        self._reported[key] = now
        # Keys that move against the new one have been released.
        motion, others = self._motions[key], self._held_until.items()
        self._held_until = {other: until for other, until in others if self._motions[other] @ motion >= 0}
        self._held_until[key] = now + (REPEAT_S if repeats else TAP_S)
