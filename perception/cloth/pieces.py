"""Pieces of a table scene that are not table, and what tells a cloth from other things."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, dilate
from layflat.perception.cloth.table_scene import MIN_SHARE, TableScene, fill_holes, is_level_face, outline_of

AREA_M2 = (0.004, 1.5)
"""Areas of a cloth: from 6 cm square."""
LOW_M, MIN_LOW_SHARE = 0.016, 0.1
"""A lying cloth's outline is no higher than this on at least this share of it."""
HIGH_M, MAX_STEEP = 0.012, 1.33
"""Share of a piece above HIGH_M, plus the share of that part's outline that falls off by STEEP_M: a cloth's is less."""
STEEP_M = 0.018
MAX_HEIGHT_M = 0.12
NEAR_M = 0.03
"""Higher parts may leave the picture."""
BESIDE = (0.15, 0.6)
"""What touches a thing with more of its outline, and does not reach this far from it (in units of its side), is the
thing's side or shadow."""
LIT_SHARE, SOFT_EDGE, MIN_CONTRAST = 0.6, 0.5, 8.0
"""Least share of a shadow that looks like the table in one; its edge within 3 pixels, as a share of its contrast; least
difference in lightness (8-bit Lab) from what is around it."""
GAP_PX = 7
"""Stripes and checks of the table's colour up to this width are closed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """Connected part of the scene that is not table."""

    mask: BoolArray
    """(h, w) without holes."""
    area_m2: float
    height_m: float
    """Median."""
    doubt: str
    """Why this is no cloth; empty if it may be one."""
    at_border: bool
    """Whether a low part touches the image's border."""

    @property
    def cloth_like(self) -> bool:
        """Whether this may be a cloth that is seen whole."""
        return not self.doubt and not self.at_border


def find_pieces(scene: TableScene) -> list[Piece]:
    """Return the pieces, largest first. Where none is like a cloth, shadows and thin bridges are taken off."""
    not_table = (scene.raised | _without_specks(scene.strange) | scene.odd) & (scene.height > -0.75 * scene.raised_m)
    loose = _open(not_table & ~scene.things & ~scene.cut, 3, cv2.MORPH_RECT)
    pieces = _split(scene, loose, GAP_PX)
    for shadow in (scene.cast, scene.shade):
        if not any(piece.cloth_like for piece in pieces):
            lit = _open(loose & ~shadow & ~dilate(scene.things, 3), 9, cv2.MORPH_ELLIPSE)
            pieces += [piece for piece in _split(scene, lit, 3) if piece.cloth_like]
    return sorted(pieces, key=lambda piece: -piece.area_m2)


def _without_specks(mask: BoolArray) -> BoolArray:
    return np.asarray(cv2.medianBlur(mask.astype(np.uint8), 3) > 0)


def _open(mask: BoolArray, size: int, shape: int) -> BoolArray:
    kernel = cv2.getStructuringElement(shape, (size, size))
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0)


def _split(scene: TableScene, mask: BoolArray, gap_px: int) -> list[Piece]:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (gap_px, gap_px))
    closed = (cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0) & ~scene.cut
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed.astype(np.uint8), connectivity=4)
    large = [label for label in range(1, count) if stats[label, cv2.CC_STAT_AREA] >= MIN_SHARE * mask.size]
    return [_measure(scene, labels == label) for label in large]


def _measure(scene: TableScene, part: BoolArray) -> Piece:
    mask = fill_holes(part)
    near = mask & (scene.height < NEAR_M)
    edges = (near[:2], near[-2:], near[:, :2], near[:, -2:])
    area, height = float(np.sum(scene.metres_per_px[mask] ** 2)), float(np.median(scene.height[part]))
    return Piece(
        mask=mask,
        area_m2=area,
        height_m=height,
        doubt=_doubt(scene, mask, area, height),
        at_border=any(bool(edge.any()) for edge in edges),
    )


def _doubt(scene: TableScene, mask: BoolArray, area: float, height: float) -> str:
    """Return the reason why a piece is no cloth."""
    outline = outline_of(mask)
    if not AREA_M2[0] < area < AREA_M2[1]:
        return f"it covers {1e4 * area:.0f} cm2"
    if height > MAX_HEIGHT_M:
        return f"it is {1000 * height:.0f} mm high"
    around = cv2.dilate(scene.height, np.ones((5, 5), np.uint8))
    edge = outline_of(mask & ~scene.cast)
    if not edge.any():
        return "it is the shadow of something tall"
    if np.mean(around[edge] < LOW_M) < MIN_LOW_SHARE:
        return f"its edge does not lie on the table, it is {1000 * float(np.median(around[edge])):.0f} mm above it"
    high = mask & (scene.height > HIGH_M)
    rim = outline_of(high)
    steep = float(np.mean(scene.steepness[rim] > STEEP_M)) if rim.any() else 0.0
    if steep > 0.5 and steep + high.sum() / mask.sum() > MAX_STEEP:
        return f"it is {1000 * height:.0f} mm high and has steep sides"
    if is_level_face(scene.height, high, least_px=0.3 * mask.sum(), px_m=math.sqrt(area / mask.sum())):
        return f"it has a level face {1000 * height:.0f} mm above the table"
    if _has_soft_edge(scene, mask, outline, height):
        return "it is a shadow or a spot of light"
    return "it is the side or the shadow of something tall" if _belongs_to_thing(scene, mask, outline, height) else ""


def _has_soft_edge(scene: TableScene, mask: BoolArray, outline: BoolArray, height: float) -> bool:
    """Return whether a low piece differs from the table by its brightness alone, which changes slowly at its edge."""
    light = scene.lab[..., 0]
    if height > scene.raised_m or max(np.mean(scene.shade[mask]), np.mean(scene.glare[mask])) < LIT_SHARE:
        return False
    ring = dilate(mask, 6) & ~dilate(mask, 3)
    if not ring.any():
        return False
    around = float(np.median(light[ring]))
    off = np.abs(light.astype(np.float32) - around)
    if np.mean(scene.strange[mask]) < 0.5 and np.median(off[mask]) - np.median(off[ring]) < MIN_CONTRAST:
        return True
    contrast = abs(float(np.median(light[mask])) - around)
    smooth = cv2.GaussianBlur(light, (5, 5), 0)
    edge = cv2.dilate(
        cv2.morphologyEx(smooth, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)), np.ones((5, 5), np.uint8)
    )
    return bool(np.median(edge[outline]) < SOFT_EDGE * contrast)


def _belongs_to_thing(scene: TableScene, mask: BoolArray, outline: BoolArray, height: float) -> bool:
    """Return whether a piece is the side or the shadow of a thing."""
    if scene.things.any():
        beside = float(np.mean(dilate(scene.things, 3)[outline]))
        gap = cv2.distanceTransform((~scene.things).astype(np.uint8), cv2.DIST_L2, 3)[mask]
        if beside > BESIDE[0] and np.percentile(gap, 95) < BESIDE[1] * math.sqrt(len(gap)):
            return True
    return height < scene.raised_m and float(np.mean(scene.cast[mask])) > 0.5
