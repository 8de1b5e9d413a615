"""Colors of the live views: pattern, side, contact and folds of a cloth differ visibly, also for color-blind people.

The face is checked and bright, the reverse is plain and orange, what rests on the table is darker, and folds have a
two-colored line. The pattern and differences of luminance carry the meaning; hue only helps.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.geometry import CONTACT_TOLERANCE_M
from layflat.sim.cloth.mesh import ClothMesh
from layflat.sim.cloth.spec import ClothSpec

Rgb: TypeAlias = tuple[int, int, int]

FACE: Rgb = (246, 248, 250)
FACE_CHECK: Rgb = (86, 180, 233)
REVERSE: Rgb = (222, 118, 20)
CONTACT_SHADE: Rgb = (0, 56, 44)
CONTACT_SHARE = 0.5
"""Share of CONTACT_SHADE in the color of cloth that rests on the table."""
FOLD: Rgb = (255, 130, 205)
FOLD_RIM: Rgb = (22, 16, 30)
HOLDER: Rgb = (240, 228, 66)
"""Hanger and pickers: what a person moves."""
ARM: Rgb = (176, 184, 196)
TABLE: Rgb = (50, 58, 70)
GRID: Rgb = (78, 90, 108)
ROOM: Rgb = (24, 29, 38)
SHADOW: Rgb = (26, 30, 37)
TARGET: Rgb = (120, 255, 190)
GHOST: Rgb = (255, 255, 255)
HAND: Rgb = (255, 96, 112)
"""A hand that pulls at the cloth: disturbance, drag, rubber band."""
AXES: tuple[Rgb, Rgb, Rgb] = ((255, 140, 90), (70, 210, 160), (120, 190, 255))
AXIS_NAMES = ("x: forward", "y: left", "z: up")

TURNED = -0.4
"""Largest z of a normal that counts as reverse side up."""
FOLD_HEIGHT_M = 0.06
"""Cloth that is higher hangs; there is no fold in it."""
FOLD_REACH_M = 0.03
"""Greatest distance of a fold's line from cloth that is turned."""


class ClothPaint:
    """Colors of the triangles of a `MeshMaker` with the same spec and subdivisions."""

    def __init__(self, spec: ClothSpec, *, subdivisions: int = 2) -> None:
        self._fine = replace(
            spec, rows=(spec.rows - 1) * subdivisions + 1, columns=(spec.columns - 1) * subdivisions + 1
        )
        self.triangles: NDArray[np.intp] = self._fine.triangles()
        """Vertex indices, (T, 3), as in `ClothMesh`."""
        row, column = np.divmod(np.arange(len(self.triangles)) // 2, self._fine.columns - 1)
        self.checked: NDArray[np.bool_] = (row // subdivisions + column // subdivisions) % 2 == 1
        """Whether a triangle of the face has the color of the checks, (T,)."""
        self._contact_m = spec.margin_m + CONTACT_TOLERANCE_M
        cell_m = min(spec.length_m / (self._fine.rows - 1), spec.width_m / (self._fine.columns - 1))
        self._reach = np.ones((2 * round(FOLD_REACH_M / cell_m) + 1,) * 2, np.uint8)
        self._face = np.where(self.checked[:, None], FACE_CHECK, FACE).astype(float)

    def resting(self, vertices: FloatArray) -> NDArray[np.bool_]:
        """Return whether each triangle rests on the table, (T,); ``vertices`` (V, 3) m."""
        rests: NDArray[np.bool_] = vertices[self.triangles, 2].mean(axis=1) < self._contact_m
        return rests

    def colors(self, vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the colors (T, 3), 0..255, of face and reverse; ``vertices`` (V, 3) m."""
        rests = self.resting(vertices)[:, None]
        reverse = np.broadcast_to(np.array(REVERSE, dtype=float), self._face.shape)
        return np.where(rests, shaded(self._face), self._face), np.where(rests, shaded(reverse), reverse)

    def fold_lines(self, mesh: ClothMesh) -> FloatArray:
        """Return segments (K, 2, 3) m along which laid cloth turns over; empty where it is not folded."""
        up, height = mesh.normals[:, 2], mesh.vertices[:, 2]
        turned = (up < TURNED) & (height < FOLD_HEIGHT_M)
        if not turned.any():
            return np.zeros((0, 2, 3))
        near = cv2.dilate(turned.reshape(self._fine.rows, -1).astype(np.uint8), self._reach).ravel() > 0
        side = up[self.triangles] < 0
        crossed = (side.any(axis=1) & ~side.all(axis=1)) & (near & (height < FOLD_HEIGHT_M))[self.triangles].all(axis=1)
        corners, side = self.triangles[crossed], side[crossed]
        # The corner that is alone on its side, and the other two: the line crosses both edges from it.
        alone = np.where(side.sum(axis=1) == 1, side.argmax(axis=1), side.argmin(axis=1))
        pick = np.arange(len(corners))
        start = corners[pick, alone]
        ends = []
        for k in (1, 2):
            end = corners[pick, (alone + k) % 3]
            share = (up[start] / (up[start] - up[end]))[:, None]
            ends.append(mesh.vertices[start] + share * (mesh.vertices[end] - mesh.vertices[start]))
        return np.stack(ends, axis=1)


def shaded(rgb: FloatArray | Rgb) -> FloatArray:
    """Return a cloth's color, (..., 3), where it rests on the table."""
    mixed: FloatArray = (1 - CONTACT_SHARE) * np.asarray(rgb, dtype=float) + CONTACT_SHARE * np.array(CONTACT_SHADE)
    return mixed


def luminance(rgb: FloatArray | Rgb) -> float:
    """Return the relative luminance of an sRGB color, 0..1 (WCAG 2.2)."""
    share = np.asarray(rgb, dtype=float) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def contrast(a: FloatArray | Rgb, b: FloatArray | Rgb) -> float:
    """Return the contrast ratio of two sRGB colors, 1..21 (WCAG 2.2)."""
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)
