"""Overlay of a ClothState on the camera's image, for people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.arrays import BoolArray, Float64Array, RgbArray, bounding_window
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.cloth.pipeline import ClothState
from layflat.perception.cloth.wrinkle_regions import WrinkleRegion
from layflat.perception.errors import PerceptionError

Color: TypeAlias = tuple[int, int, int]

CONTACT: Color = (70, 225, 150)
CLOTH: Color = (255, 255, 255)
ARROW: Color = (255, 196, 0)
WARNING: Color = (255, 92, 70)
INK: Color = (24, 28, 36)

TINT = 0.38
"""Opacity of the contact's tint."""
ARROW_M = 0.12
"""Length of WORD's arrow on the table."""
REGION_ARROW_M = 0.06
"""Length of a region's arrow."""
REFERENCE_WIDTH = 320
"""Width of an image with the thinnest lines and the smallest letters; both grow with the image."""
MIN_OUTLINE_AREA_PX = 30
_SHIFT = 4
"""Fractional bits of the drawing coordinates: outlines on a small image would otherwise move in whole pixels."""


def draw_cloth_state(
    rgb: RgbArray, state: ClothState, camera: PinholeCamera, scale: int = 1, label: str = "WORD"
) -> RgbArray:
    """Return the image (H, W, 3), enlarged ``scale`` times, with contact tinted, the cloth outlined, WORD as an arrow.

    ``label`` names the arrow. The contact portion is written in the corner.
    """
    if rgb.shape != (camera.height, camera.width, 3):
        raise PerceptionError(f"rgb has shape {rgb.shape}; this camera gives {(camera.height, camera.width, 3)}")
    if scale < 1:
        raise PerceptionError(f"scale is {scale}; it must be at least 1")
    size = (camera.width * scale, camera.height * scale)
    canvas = np.array(cv2.resize(rgb, size, interpolation=cv2.INTER_CUBIC) if scale > 1 else rgb, dtype=np.uint8)
    to_canvas = _grid_to_canvas(state, camera, scale)
    pen = max(1, round(canvas.shape[1] / REFERENCE_WIDTH))
    _tint(canvas, state.contact_mask, to_canvas)
    _outline(canvas, state.cloth_mask, to_canvas, CLOTH, pen)
    _outline(canvas, state.contact_mask, to_canvas, CONTACT, pen)
    _draw_word(canvas, state, to_canvas, pen)
    _write_numbers(canvas, state, pen, label)
    return canvas


def draw_regions(image: RgbArray, regions: Sequence[WrinkleRegion], grid: TableGrid, camera: PinholeCamera) -> RgbArray:
    """Return the image (H, W, 3) with each region of ``grid`` outlined and its direction as an arrow."""
    canvas, to_canvas = image.copy(), camera.table_to_pixel @ grid.pixel_to_table
    pen = max(1, round(canvas.shape[1] / REFERENCE_WIDTH))
    for region in regions:
        _outline(canvas, region.mask, to_canvas, ARROW, 1)
    for region in regions:
        half = REGION_ARROW_M / 2 * region.wrinkles.axis
        tail, head = _warp(grid.to_pixel([region.place_m - half, region.place_m + half]), to_canvas)
        for color, rim in ((INK, 1), (ARROW, 0)):
            _arrow(canvas, tail, head, color, width=pen, rim=rim)
    return canvas


def draw_refusal(rgb: RgbArray, taken: BoolArray) -> RgbArray:
    """Return the image (H, W, 3) with the pixels that were found (H, W) outlined, and that they are no whole cloth."""
    canvas = np.array(rgb, dtype=np.uint8)
    pen = max(1, round(canvas.shape[1] / REFERENCE_WIDTH))
    _outline(canvas, taken, np.eye(3), WARNING, 2 * pen)
    _write_lines(canvas, [("not taken for a cloth" if taken.any() else "nothing stands out", WARNING)], pen)
    return canvas


def _grid_to_canvas(state: ClothState, camera: PinholeCamera, scale: int) -> Float64Array:
    """Return the (3, 3) homography from grid pixels to the enlarged image (pixel centres at integers in both)."""
    shift = (scale - 1) / 2
    enlarge = np.array([[scale, 0.0, shift], [0.0, scale, shift], [0.0, 0.0, 1.0]])
    return enlarge @ camera.table_to_pixel @ state.grid.pixel_to_table


def _tint(canvas: RgbArray, mask: BoolArray, to_canvas: Float64Array) -> None:
    """Blend the contact's colour in, with a soft edge."""
    size = (canvas.shape[1], canvas.shape[0])
    cover = np.asarray(cv2.warpPerspective(mask.astype(np.float32), to_canvas, size, flags=cv2.INTER_LINEAR))
    part = bounding_window(cover > 0)  # blending the whole image would take longer than perceiving it
    if part is None:
        return
    alpha = (TINT * cover[part])[..., None]
    canvas[part] = np.rint(canvas[part] * (1 - alpha) + np.array(CONTACT) * alpha).astype(np.uint8)


def _outline(canvas: RgbArray, mask: BoolArray, to_canvas: Float64Array, color: Color, pen: int) -> None:
    """Draw the mask's outlines and those of its holes, without specks."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    for contour in contours:
        if cv2.contourArea(contour) >= MIN_OUTLINE_AREA_PX:
            points = _fixed_point(_warp(contour.reshape(-1, 2), to_canvas))
            cv2.polylines(canvas, [points], True, color, max(1, pen // 2), cv2.LINE_AA, _SHIFT)


def _draw_word(canvas: RgbArray, state: ClothState, to_canvas: Float64Array, pen: int) -> None:
    """Draw WORD as an arrow on the table from the contact's centroid; nothing if there is no direction."""
    if state.contact_pixels == 0 or not state.word.any():
        return
    rows, columns = np.nonzero(state.contact_mask)
    start = state.grid.to_table([columns.mean(), rows.mean()])[0]
    tail, head = _warp(state.grid.to_pixel([start, start + ARROW_M * state.word]), to_canvas)
    for color, rim in ((INK, 2), (ARROW, 0)):
        _arrow(canvas, tail, head, color, width=2 * pen, rim=rim)


def _arrow(canvas: RgbArray, tail: Float64Array, head: Float64Array, color: Color, *, width: float, rim: float) -> None:
    """Fill an arrow ``width`` px thick, grown by ``rim`` px on all sides (for a dark rim under the bright one)."""
    length = float(np.linalg.norm(head - tail))
    if length < 1e-6:
        return
    along = (head - tail) / length
    side = np.array([-along[1], along[0]])
    barb = min(5.0 * width, 0.6 * length)
    half, wing = width / 2 + rim, 2.0 * width + rim * 1.6
    neck = head - along * (barb + rim)
    end, tip = tail - along * rim, head + along * rim * 1.8
    shape = [end + side * half, neck + side * half, neck + side * wing, tip]
    shape += [neck - side * wing, neck - side * half, end - side * half]
    cv2.fillPoly(canvas, [_fixed_point(np.array(shape))], color, cv2.LINE_AA, _SHIFT)


def _write_numbers(canvas: RgbArray, state: ClothState, pen: int, label: str) -> None:
    """Write contact portion, WORD's direction and strength, and a warning, on a dark strip at the bottom left."""
    portion = state.contact_portion
    contact = f"{state.contact_pixels} px" if math.isnan(portion) else f"{100 * portion:.1f} %"
    lines = [(f"contact {contact}", CONTACT)]
    if state.word.any():
        angle = math.degrees(math.atan2(state.word[1], state.word[0]))
        lines.append((f"{label} {angle:+.0f} deg  {state.strength:.3f}", ARROW))
    if state.out_of_view:
        lines.append(("out of view", WARNING))
    _write_lines(canvas, lines, pen)


def _write_lines(canvas: RgbArray, lines: list[tuple[str, Color]], pen: int) -> None:
    font, size, weight = cv2.FONT_HERSHEY_SIMPLEX, 0.36 * pen, max(1, round(0.5 * pen))
    pitch, pad = 13 * pen, 5 * pen
    extent = max(cv2.getTextSize(text, font, size, weight)[0][0] for text, _ in lines)
    top = canvas.shape[0] - pitch * len(lines) - pad
    box = canvas[top:, : extent + 2 * pad]
    box[:] = (box * 0.35 + np.array(INK) * 0.65).astype(np.uint8)
    for index, (text, color) in enumerate(lines):
        origin = (pad, top + pitch * (index + 1) - pitch // 4)
        cv2.putText(canvas, text, origin, font, size, color, weight, cv2.LINE_AA)


def _warp(points: NDArray[Any], homography: Float64Array) -> Float64Array:
    """Map points (N, 2) by a homography."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return mapped[:, :2] / mapped[:, 2:]


def _fixed_point(points: Float64Array) -> NDArray[np.int32]:
    return np.rint(points * 2**_SHIFT).astype(np.int32)
