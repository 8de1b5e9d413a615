"""Draws a ClothState on the camera's image, for people."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import BoolArray
from layflat.perception.cloth.pipeline import ClothState
from layflat.perception.errors import PerceptionError

Colour: TypeAlias = tuple[int, int, int]

CONTACT: Colour = (70, 225, 150)
CLOTH: Colour = (255, 255, 255)
ARROW: Colour = (255, 196, 0)
WARNING: Colour = (255, 92, 70)
INK: Colour = (24, 28, 36)

TINT = 0.38
"""Opacity of the contact's tint."""
ARROW_M = 0.12
"""Length of WORD's arrow on the table."""
PEN_WIDTH = 320
"""Width of a picture with the thinnest lines and the smallest letters; both grow with larger ones."""
_SHIFT = 4
"""Fractional bits of the drawing coordinates: outlines on a small image would else step by whole pixels."""


def draw_cloth_state(
    rgb: NDArray[np.uint8], cloth_state: ClothState, camera: PinholeCamera, scale: int = 1, label: str = "WORD"
) -> NDArray[np.uint8]:
    """The image (H, W, 3) enlarged ``scale`` times, with contact tinted, the cloth outlined, WORD as an arrow.

    The arrow starts at the contact's centroid and lies on the table; the contact portion is written in the corner.
    ``label`` names the arrow. Returns uint8 RGB; the input is left as it is.
    """
    if rgb.shape != (camera.height, camera.width, 3):
        raise PerceptionError(f"rgb has shape {rgb.shape}; this camera gives {(camera.height, camera.width, 3)}")
    if scale < 1:
        raise PerceptionError(f"scale is {scale}; it must be at least 1")
    size = (camera.width * scale, camera.height * scale)
    canvas = np.array(cv2.resize(rgb, size, interpolation=cv2.INTER_CUBIC) if scale > 1 else rgb, dtype=np.uint8)
    to_canvas = _grid_to_canvas(cloth_state, camera, scale)
    pen = max(1, round(canvas.shape[1] / PEN_WIDTH))
    _tint(canvas, cloth_state.contact_mask, to_canvas)
    _outline(canvas, cloth_state.cloth_mask, to_canvas, CLOTH, pen)
    _outline(canvas, cloth_state.contact_mask, to_canvas, CONTACT, pen)
    _draw_word(canvas, cloth_state, to_canvas, pen)
    _write_numbers(canvas, cloth_state, pen, label)
    return canvas


def _grid_to_canvas(cloth_state: ClothState, camera: PinholeCamera, scale: int) -> NDArray[np.float64]:
    """(3, 3) homography from grid pixels to the enlarged image (pixel centres at whole numbers in both)."""
    shift = (scale - 1) / 2
    enlarge = np.array([[scale, 0.0, shift], [0.0, scale, shift], [0.0, 0.0, 1.0]])
    return enlarge @ camera.table_to_pixel @ cloth_state.grid.pixel_to_table


def _tint(canvas: NDArray[np.uint8], mask: BoolArray, to_canvas: NDArray[np.float64]) -> None:
    """Blend the contact's colour in, with a soft edge."""
    size = (canvas.shape[1], canvas.shape[0])
    cover = cv2.warpPerspective(mask.astype(np.float32), to_canvas, size, flags=cv2.INTER_LINEAR)
    rows, columns = (np.flatnonzero(np.asarray(cover).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return
    # Only where there is contact: blending the whole picture would take longer than seeing it.
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    alpha = (TINT * np.asarray(cover)[part])[..., None]
    canvas[part] = np.rint(canvas[part] * (1 - alpha) + np.array(CONTACT) * alpha).astype(np.uint8)


def _outline(
    canvas: NDArray[np.uint8], mask: BoolArray, to_canvas: NDArray[np.float64], colour: Colour, scale: int
) -> None:
    """The mask's outlines and those of its holes; specks of a few pixels are left out."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    for contour in contours:
        if cv2.contourArea(contour) < 30:
            continue
        points = _warp(contour.reshape(-1, 2), to_canvas)
        fixed = np.rint(points * 2**_SHIFT).astype(np.int32)
        cv2.polylines(canvas, [fixed], True, colour, max(1, scale // 2), cv2.LINE_AA, _SHIFT)


def _draw_word(canvas: NDArray[np.uint8], cloth_state: ClothState, to_canvas: NDArray[np.float64], scale: int) -> None:
    """WORD as an arrow on the table from the contact's centroid; nothing where there is no direction."""
    if cloth_state.contact_pixels == 0 or not cloth_state.word.any():
        return
    rows, columns = np.nonzero(cloth_state.contact_mask)
    start = cloth_state.grid.to_table([columns.mean(), rows.mean()])[0]
    tail, head = _warp(cloth_state.grid.to_pixel([start, start + ARROW_M * cloth_state.word]), to_canvas)
    for colour, extra in ((INK, 2), (ARROW, 0)):
        _arrow(canvas, tail, head, colour, width=2 * scale, extra=extra)


def _arrow(
    canvas: NDArray[np.uint8],
    tail: NDArray[np.float64],
    head: NDArray[np.float64],
    colour: Colour,
    *,
    width: float,
    extra: float,
) -> None:
    """A filled arrow ``width`` px thick, grown by ``extra`` px on all sides (for a dark rim under the bright one)."""
    length = float(np.linalg.norm(head - tail))
    if length < 1e-6:
        return
    along = (head - tail) / length
    side = np.array([-along[1], along[0]])
    barb = min(5.0 * width, 0.6 * length)
    half, wing = width / 2 + extra, 2.0 * width + extra * 1.6
    neck = head - along * (barb + extra)
    end, tip = tail - along * extra, head + along * extra * 1.8
    shape = [end + side * half, neck + side * half, neck + side * wing, tip]
    shape += [neck - side * wing, neck - side * half, end - side * half]
    fixed = np.rint(np.array(shape) * 2**_SHIFT).astype(np.int32)
    cv2.fillPoly(canvas, [fixed], colour, cv2.LINE_AA, _SHIFT)


def _write_numbers(canvas: NDArray[np.uint8], cloth_state: ClothState, scale: int, label: str) -> None:
    """Contact portion, WORD's direction and strength, and a warning, on a dark strip at the bottom left."""
    known = not math.isnan(cloth_state.contact_portion)
    lines = [
        (
            f"contact {100 * cloth_state.contact_portion:.1f} %"
            if known
            else f"contact {cloth_state.contact_pixels} px",
            CONTACT,
        )
    ]
    if cloth_state.word.any():
        angle = math.degrees(math.atan2(cloth_state.word[1], cloth_state.word[0]))
        lines.append((f"{label} {angle:+.0f} deg  {cloth_state.strength:.3f}", ARROW))
    if cloth_state.out_of_view:
        lines.append(("out of view", WARNING))
    font, size, weight = cv2.FONT_HERSHEY_SIMPLEX, 0.36 * scale, max(1, round(0.5 * scale))
    pitch, pad = 13 * scale, 5 * scale
    extent = max(cv2.getTextSize(text, font, size, weight)[0][0] for text, _ in lines)
    top = canvas.shape[0] - pitch * len(lines) - pad
    box = canvas[top:, : extent + 2 * pad]
    box[:] = (box * 0.35 + np.array(INK) * 0.65).astype(np.uint8)
    for index, (text, colour) in enumerate(lines):
        origin = (pad, top + pitch * (index + 1) - pitch // 4)
        cv2.putText(canvas, text, origin, font, size, colour, weight, cv2.LINE_AA)


def _warp(points: NDArray[Any], homography: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (N, 2) through a homography."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return mapped[:, :2] / mapped[:, 2:]
