"""What keys do, the same in a terminal and in a window. Keys go by names: ``a``, ``A``, ``shift-left``, ``enter``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np

from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

CONTROLS: Mapping[str, Command] = {
    "enter": Command.START,
    "space": Command.PAUSE,
    "y": Command.KEEP_SUCCESS,
    "n": Command.KEEP_FAILURE,
    "x": Command.DISCARD,
    "r": Command.REDO,
    "b": Command.DISTURB,
    "q": Command.QUIT,
}
LABELS = {"enter": "Enter", "space": "Space"}
SPEED = 0.5
SPEEDS = {str(digit): digit / 10 if digit else 1.0 for digit in range(10)}

Ways: TypeAlias = dict[str, tuple[int, int, int]]
_WAYS: Ways = {
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
"""x, y, z of whatever holds the cloth; y as the person sees it, to the right."""
_DIAGONALS = "up and forth, down and forth, down and back"
_LEFT: Ways = {
    "a": (-1, 0, 0),
    "d": (1, 0, 0),
    "w": (0, 0, 1),
    "s": (0, 0, -1),
    "A": (0, -1, 0),
    "D": (0, 1, 0),
}
_RIGHT: Ways = {
    "j": (-1, 0, 0),
    "l": (1, 0, 0),
    "i": (0, 0, 1),
    "k": (0, 0, -1),
    "J": (0, -1, 0),
    "L": (0, 1, 0),
}


def key_motions(robot: RobotSpec, *, left: int = 2) -> dict[str, FloatArray]:
    """(A,) of each key that moves. ``left``: the picker on the left as the person sees it, as for pads."""
    if robot.n_points == 1:
        packed = {key: robot.pack(way) for key, way in (_WAYS | _LEFT).items()}
        return {key: way for key, way in packed.items() if way.any()}
    across = 1.0 if left == 2 else -1.0
    found = {}
    for rows, ways in (([left - 1], _LEFT), ([2 - left], _RIGHT), ([0, 1], _WAYS)):
        for key, (x, y, z) in ways.items():
            pair = np.zeros((2, 3))
            pair[rows] = (x, across * y, z)
            found[key] = robot.pack(pair)
    return found


def sum_motions(robot: RobotSpec, moves: Mapping[str, FloatArray], held: Iterable[str]) -> FloatArray:
    """(A,) in [-1, 1] of several keys held together."""
    total = robot.zeros()
    for key in held:
        total = total + moves[key]
    return np.clip(total, -1.0, 1.0)


def help_of(robot: RobotSpec) -> tuple[Button, ...]:
    """What the keys do."""
    controls = (Button(LABELS.get(key, key), control.value, control) for key, control in CONTROLS.items())
    return (*_MOVES[robot.n_points], Button("1..9 0", "speed, 5 at first, 0 is the fastest"), *controls)


_MOVES: Mapping[int, tuple[Button, ...]] = {
    1: (Button("arrows, w a s d", "up, back, down, forth"), Button("e c z", _DIAGONALS)),
    2: (
        Button("w a s d", "left picker up, back, down, forth; A D to the left, to the right"),
        Button("i j k l", "right picker likewise; J L to the left, to the right"),
        Button("arrows", "both; with shift to the left, to the right"),
        Button("e c z", f"both, {_DIAGONALS}"),
    ),
}
