"""Keys of the terminal and the window: names such as ``a``, ``A``, ``shift-left``, ``enter``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np

from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleoperator import Button
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

Directions: TypeAlias = dict[str, tuple[int, int, int]]
"""x, y, z of each key."""
_ALL_POINTS: Directions = {
    "left": (-1, 0, 0),
    "right": (1, 0, 0),
    "up": (0, 0, 1),
    "down": (0, 0, -1),
    "shift-left": (0, -1, 0),
    "shift-right": (0, 1, 0),
    "e": (1, 0, 1),
    "c": (1, 0, -1),
    "z": (-1, 0, -1),
}


def _six(back: str, forward: str, up: str, down: str) -> Directions:
    """Return the directions of four keys; with shift the first two move left and right."""
    directions = {back: (-1, 0, 0), forward: (1, 0, 0), up: (0, 0, 1), down: (0, 0, -1)}
    return directions | {back.upper(): (0, -1, 0), forward.upper(): (0, 1, 0)}


_LEFT_POINT, _RIGHT_POINT = _six("a", "d", "w", "s"), _six("j", "l", "i", "k")


def key_motions(robot: RobotSpec) -> dict[str, FloatArray]:
    """Return the motion (A,) of each key that moves the robot."""
    if robot.n_points == 1:
        packed = {key: robot.pack(direction) for key, direction in (_ALL_POINTS | _LEFT_POINT).items()}
        return {key: motion for key, motion in packed.items() if motion.any()}
    found = {}
    for points, directions in (([LEFT], _LEFT_POINT), ([RIGHT], _RIGHT_POINT), ([LEFT, RIGHT], _ALL_POINTS)):
        for key, direction in directions.items():
            pair = np.zeros((2, 3))
            pair[points] = direction
            found[key] = robot.pack(pair)
    return found


def sum_motions(robot: RobotSpec, motions: Mapping[str, FloatArray], held: Iterable[str]) -> FloatArray:
    """Return the motion (A,) in [-1, 1] of several keys held together."""
    return np.clip(sum((motions[key] for key in held), robot.zeros()), -1.0, 1.0)


def key_help(robot: RobotSpec) -> tuple[Button, ...]:
    """Return the effect of each key."""
    commands = (Button(LABELS.get(key, key), command.value, command) for key, command in COMMANDS.items())
    return (*_MOTION_HELP[robot.n_points], Button("1..9 0", "speed: 5 at first, 0 is the fastest"), *commands)


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
