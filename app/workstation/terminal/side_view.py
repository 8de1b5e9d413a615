"""Cloth from the side in characters: forward is to the right, up is up; works over SSH."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.data.arrays import FloatArray
from layflat.sim.cloth.registry import cloth_spec

X_M, Z_M = (-0.2, 0.75), (0.0, 0.52)
"""What is seen of the plane of motion."""
TICK_M = 0.1
_BRAILLE = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_HALVES = " '.:"


def side_view(frame: SimulationFrame, columns: int, rows: int, *, plain: bool = False) -> list[str]:
    """Return so many lines of so many characters, the last of them the table; ``plain``: in ASCII."""
    wide, high = (1, 2) if plain else (2, 4)
    size = np.array([columns * wide, (rows - 1) * high])
    # A character is about twice as high as wide, so its dots are square.
    dots_m = float(min(size / (np.ptp(X_M), np.ptp(Z_M))))

    def dots(points: FloatArray) -> FloatArray:
        along = (points[:, 0] - X_M[0]) * dots_m
        up = size[1] - 1 - (points[:, 2] - Z_M[0]) * dots_m
        return np.stack([along, up], axis=1)

    canvas = np.zeros((size[1], size[0]), np.uint8)
    spec = cloth_spec(frame.cloth)
    if len(frame.nodes) == spec.rows * spec.columns:
        for line in frame.nodes.reshape(spec.rows, spec.columns, 3).swapaxes(0, 1):
            cv2.polylines(canvas, [np.rint(dots(line)).astype(np.int32)], False, 1)
    lines = _braille(canvas) if not plain else _halves(canvas)
    for at in np.unique(np.rint(dots(frame.corners)).astype(int), axis=0).tolist():
        lines = _put(lines, at[0] // wide, at[1] // high, "V" if plain else "▼")
    marks = [round((x - X_M[0]) * dots_m) // wide for x in np.arange(-0.2, 0.8, TICK_M)]
    rule, tick = ("-", "+") if plain else ("─", "┴")
    return [*lines, "".join(tick if k in marks else rule for k in range(columns))]


def _braille(canvas: NDArray[np.uint8]) -> list[str]:
    cells = canvas.reshape(canvas.shape[0] // 4, 4, canvas.shape[1] // 2, 2)
    codes = np.einsum("rick,ik->rc", cells.astype(int), _BRAILLE)
    return ["".join(chr(0x2800 + code) if code else " " for code in row) for row in codes.tolist()]


def _halves(canvas: NDArray[np.uint8]) -> list[str]:
    codes = canvas[0::2].astype(int) + 2 * canvas[1::2]
    return ["".join(_HALVES[code] for code in row) for row in codes.tolist()]


def _put(lines: list[str], column: int, row: int, mark: str) -> list[str]:
    """Return the lines with a mark, if it is among them."""
    if not (0 <= row < len(lines) and 0 <= column < len(lines[0])):
        return lines
    line = lines[row]
    return [*lines[:row], line[:column] + mark + line[column + 1 :], *lines[row + 1 :]]
