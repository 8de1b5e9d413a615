"""Finder of a cloth of any look on a table: by depth and colour together, its outline by OpenCV's GrabCut."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from layflat.perception.arrays import (
    WHOLE,
    BoolArray,
    Float32Array,
    FloatArray,
    RgbArray,
    Window,
    bounding_window,
    dilate,
    erode,
)
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.table_plane import fit_table_plane
from layflat.perception.cloth.pieces import Piece, find_pieces
from layflat.perception.cloth.table_scene import TableScene, fill_holes, look_at_table, reduce_frame

RIVAL_SHARE = 0.7
"""A second piece this large, compared with the largest, may be the cloth as well."""
ITERATIONS = 2
MAX_SHARPENED_PX = 120_000
"""Cloths in larger windows have the outline of the reduced image: there a pixel is a small share of them."""
LIT_SHARE = 0.4
"""Where less of the piece looks like the table in a shadow, or in strong light, that part is left to GrabCut."""
PATCH_SHARE, PATCH_COLOR, PATCH_HEIGHT_M = 0.12, 5.0, 0.003
"""A part of something else: colour (8-bit Lab) and height change by less on more than this share of its outline."""
FLAP_SHARE = 0.3
"""A smaller piece that touches the cloth, parted by a step of height, may be a flap of it."""
REST_SHARE = 0.8
"""Without that part, this much of the piece must be left in one; else it is the pattern of the cloth."""
PART_SHARE, PART_COLOR = 0.05, 15.0
"""Parts of a cloth beyond an arm that lies across it: least share of its area, largest difference of colour (Lab)."""
_SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, kw_only=True, eq=False)
class Finding:
    """Result of the search in a frame: what stands out."""

    scene: TableScene
    pieces: list[Piece]
    """Largest first."""
    distance_m: float
    """Distance from the camera to the table's plane."""
    rgb: RgbArray
    """(H, W, 3) the frame's picture."""

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) of the frame."""
        return self.rgb.shape[0], self.rgb.shape[1]

    def cloths(self) -> list[Piece]:
        """Return the pieces that may be the cloth: the largest, and others nearly as large."""
        good = [piece for piece in self.pieces if piece.cloth_like]
        return [piece for piece in good if piece.area_m2 >= RIVAL_SHARE * good[0].area_m2]

    def at(self, point: tuple[int, int]) -> Piece | None:
        """Return the piece at a pixel (column, row) of the frame."""
        row, column = (
            min(at * size // whole, size - 1)
            for at, size, whole in zip(point[::-1], self.scene.cut.shape, self.shape, strict=True)
        )
        return next((piece for piece in self.pieces if piece.mask[row, column]), None)

    def containing(self, mask: BoolArray) -> Piece | None:
        """Return the piece that most of a mask (H, W) lies in."""
        small = self._reduced(mask)
        half = 0.5 * np.count_nonzero(small)
        return next((piece for piece in self.pieces if np.count_nonzero(piece.mask & small) > half), None)

    def doubt_about(self, mask: BoolArray) -> str:
        """Return why a mask (H, W) may be no cloth; empty if nothing tells."""
        piece = self.containing(mask)
        if piece is not None:
            return piece.doubt
        small = self._reduced(mask)
        high = np.count_nonzero(small & self.scene.things) > 0.5 * np.count_nonzero(small)
        return f"it stands {1000 * float(np.median(self.scene.height[small])):.0f} mm above the table" if high else ""

    def _reduced(self, mask: BoolArray) -> BoolArray:
        height, width = self.scene.cut.shape
        return np.asarray(cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0)

    def middle(self, piece: Piece) -> tuple[int, int]:
        """Return the pixel (column, row) of the frame that is deepest inside a piece."""
        inside = cv2.distanceTransform(np.pad(piece.mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
        row, column = np.unravel_index(int(np.argmax(inside)), inside.shape)
        factor = max(1, self.shape[1] // inside.shape[1])
        return int(column) * factor + factor // 2, int(row) * factor + factor // 2

    def outline(self, piece: Piece) -> BoolArray:
        """Return the mask (H, W) of a piece in the frame, refined by colour."""
        coarse = _refine(self.scene, piece, [other for other in self.pieces if not other.cloth_like])
        return _sharpen(self.rgb, self.enlarge(coarse), max(1, self.shape[1] // coarse.shape[1]))

    def is_patch(self, mask: BoolArray) -> bool:
        """Return whether a mask (H, W) ends, on a good part of its outline, where neither colour nor height change."""
        part = self._reduced(mask)
        rim = part & ~erode(part, 1)
        images = (self.scene.lab.astype(np.float32) / PATCH_COLOR, self.scene.height / np.float32(PATCH_HEIGHT_M))
        steps = []
        for image in images:
            inner, outer = (_mean_over(image, where) for where in (erode(part, 1), ~dilate(part, 1)))
            step = np.abs(inner - outer)[rim]
            steps.append(step.max(axis=-1) if step.ndim > 1 else step)
        return bool(np.mean(np.maximum(*steps) < 1) > PATCH_SHARE) if rim.any() else False

    def enlarge(self, mask: BoolArray) -> BoolArray:
        """Return a reduced mask at the frame's size."""
        factor = max(1, self.shape[1] // mask.shape[1])
        whole = cv2.resize(mask.astype(np.float32), (mask.shape[1] * factor, mask.shape[0] * factor))
        bottom, right = (whole_px - px for whole_px, px in zip(self.shape, whole.shape, strict=True))
        return np.asarray(np.pad(whole, ((0, bottom), (0, right)), mode="edge") > 0.5)


def find_cloth(rgb: RgbArray, depth: FloatArray, intrinsics: Intrinsics, *, rng: np.random.Generator) -> Finding:
    """Find what is not table in a frame of depth (H, W) m, 0 where missing. PerceptionError without a table."""
    picture, near, lens = reduce_frame(rgb, depth, intrinsics)
    plane = fit_table_plane(near, lens, rng=rng)
    scene = look_at_table(picture, near, plane.camera(lens))
    return Finding(scene=scene, pieces=find_pieces(scene), distance_m=plane.distance_m, rgb=rgb)


def _refine(scene: TableScene, piece: Piece, others: list[Piece]) -> BoolArray:
    """Return the piece with the outline that its colours have, by GrabCut around it."""
    side = math.sqrt(np.count_nonzero(piece.mask))
    window = bounding_window(piece.mask, margin=max(6, round(0.3 * side)))
    if window is None:
        return piece.mask
    whole, lit = piece.mask[window], np.zeros_like(piece.mask[window])
    for light in (scene.shade[window], scene.glare[window]):
        if np.mean(light[whole]) < LIT_SHARE:
            lit |= light
    mask = fill_holes(_largest(cv2.morphologyEx((whole & ~lit).astype(np.uint8), cv2.MORPH_OPEN, _SQUARE) > 0))
    if np.count_nonzero(mask) < REST_SHARE * np.count_nonzero(whole):  # stripes of that brightness part the cloth
        mask = whole
    labels = np.full(mask.shape, cv2.GC_PR_BGD, np.uint8)
    labels[~dilate(mask, max(4, 0.2 * side))] = cv2.GC_BGD
    for other in others:
        if (other.mask & piece.mask).any():
            continue
        flap = other.area_m2 < FLAP_SHARE * piece.area_m2 and (dilate(other.mask[window], 3) & whole).any()
        if _parted(scene, piece.mask, other.mask):
            labels[other.mask[window] & ~scene.shade[window]] = cv2.GC_PR_FGD
        elif not flap:
            labels[other.mask[window] & ~whole] = cv2.GC_BGD
    labels[erode(scene.things[window], 2)] = cv2.GC_BGD
    labels[mask] = cv2.GC_PR_FGD
    core = cv2.erode(mask.astype(np.uint8), _SQUARE, iterations=max(1, round(0.1 * side))) > 0
    labels[core] = cv2.GC_FGD
    labels[lit & (labels != cv2.GC_BGD)] = cv2.GC_PR_BGD
    inner = cv2.erode(mask.astype(np.uint8), _SQUARE) > 0  # the outermost pixels are mixed with the table
    labels[inner & scene.strange[window] & ~scene.shade[window] & ~scene.glare[window]] = cv2.GC_FGD
    if not (labels & 1 == 0).any() or not (labels & 1).any():
        return piece.mask
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    picture = np.ascontiguousarray(scene.lab[window])
    cv2.grabCut(picture, labels, (0, 0, 1, 1), *models, ITERATIONS, cv2.GC_INIT_WITH_MASK)
    refined = np.zeros(piece.mask.shape, dtype=np.bool_)
    found = fill_holes((labels & 1) > 0)
    main = _largest(found)
    count, parts, stats, _ = cv2.connectedComponentsWithStats((found & ~main).astype(np.uint8), connectivity=8)
    for part in range(1, count):
        large = stats[part, cv2.CC_STAT_AREA] > PART_SHARE * np.count_nonzero(main)
        if large and _parted(scene, main, parts == part, window):
            main = main | (parts == part)
    refined[window] = main
    return refined


def _parted(scene: TableScene, main: BoolArray, other: BoolArray, window: Window = WHOLE) -> bool:
    """Return whether a thing that lies across the cloth parts it from another piece: both touch it and look alike."""
    thing = dilate(scene.things[window], 3)
    if not (thing & main).any() or not (thing & other).any():
        return False
    lab, clear = scene.lab[window], ~scene.shade[window]
    if not (main & clear).any() or not (other & clear).any():
        return False
    colors = [np.median(lab[mask & clear], axis=0) for mask in (main, other)]
    return bool(np.abs(colors[0] - colors[1]).max() < PART_COLOR)


def _mean_over(image: Float32Array, where: BoolArray) -> Float32Array:
    """Return the mean of the neighbours that are in a mask."""
    share = cv2.blur(where.astype(np.float32), (9, 9)) + np.float32(1e-3)
    weight = where.astype(np.float32)
    total = cv2.blur(image * (weight if image.ndim == 2 else weight[..., None]), (9, 9))
    return np.asarray(total / (share if image.ndim == 2 else share[..., None]), np.float32)


def _sharpen(rgb: RgbArray, mask: BoolArray, factor: int) -> BoolArray:
    """Return a mask from an image ``factor`` times smaller with its outline fitted to the picture's pixels."""
    window = bounding_window(mask, margin=4 * factor)
    if factor == 1 or window is None or mask[window].size > MAX_SHARPENED_PX:
        return mask
    part = mask[window]
    labels = np.where(part, np.uint8(cv2.GC_PR_FGD), np.uint8(cv2.GC_PR_BGD))
    labels[~dilate(part, 1.5 * factor)] = cv2.GC_BGD
    labels[erode(part, 1.5 * factor)] = cv2.GC_FGD
    if not (labels == cv2.GC_FGD).any() or not (labels == cv2.GC_BGD).any():
        return mask
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    picture = np.ascontiguousarray(rgb[window])
    cv2.grabCut(picture, labels, (0, 0, 1, 1), *models, 1, cv2.GC_INIT_WITH_MASK)
    sharp = np.zeros_like(mask)
    sharp[window] = fill_holes(_largest((labels & 1) > 0))
    return sharp


def _largest(mask: BoolArray) -> BoolArray:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return mask if count <= 2 else np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))
