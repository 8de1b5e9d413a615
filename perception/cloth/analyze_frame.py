"""State of the cloth in one RGB-D frame of an unknown camera: colour, table and pose come from the frame itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, FloatArray, RgbArray, touches_border
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.camera.table_grid import TableGrid, grid_around
from layflat.perception.camera.table_plane import TablePlane, fit_table_plane
from layflat.perception.cloth.color_calibration import learn_hsv, suggest_hsv
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.perception.errors import PerceptionError

ColorSource: TypeAlias = Literal["given", "learned", "suggested"]

TABLE_RANGE_M = (0.15, 6.0)
"""Distances from which a D4xx camera sees cloth on a table; outside, the unit of the depth is wrong."""
ON_TABLE_M = (-0.03, 0.6)
"""Heights above the table where a cloth of unknown colour is searched."""
SUNKEN_M = -0.02
"""A cloth mostly below this lies on something else than the fitted plane."""
REFERENCE_WIDTH = 320
"""Image width that PerceptionConfig's camera pixels are meant for; they are scaled to the image."""
PIECE_SHARE, PIECE_GAP = 0.02, 0.12
"""Smallest piece of the cloth's colour that belongs to the cloth, share of the main piece; largest gap between them
(something lies across the cloth), share of its side."""
NOISY_SHARE, HOLES_SHARE = 0.5, 0.3
"""Warn where the depth scatters by more than this share of the contact height, or is missing on more of the cloth."""
MIN_DEPTH_SHARE = 0.2
"""Share of the cloth that must have a depth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameResult:
    """State of the cloth in a frame, and what was inferred about the camera."""

    cloth_state: ClothState
    """In table coordinates that are the image's: x right, y up (``TablePlane.camera``)."""
    camera: PinholeCamera
    plane: TablePlane
    config: PerceptionConfig
    """Settings with the cloth's colour, and lengths scaled to the image."""
    color_source: ColorSource
    cloth_mask: BoolArray
    """(H, W) pixels of the image that were taken for the cloth."""
    view: ClothView
    """Input of a descriptor."""
    warnings: tuple[str, ...]
    """Reasons to doubt the numbers, a sentence each."""


def analyze_frame(
    rgb: RgbArray,
    depth: FloatArray,
    intrinsics: Intrinsics,
    *,
    color: HsvRange | None = None,
    cloth_at: tuple[int, int] | None = None,
    contact_height_m: float = PerceptionConfig.contact_height_m,
    flat_pixels: int | None = None,
    rng: np.random.Generator,
) -> FrameResult:
    """Estimate the state of the cloth in a frame of a camera with unknown pose; ``depth`` is aligned with ``rgb``.

    The cloth's ``color`` is by default learned at the pixel ``cloth_at`` (column, row) of the cloth, else suggested.
    ``rng`` draws the pixels and trials of the table fit. PerceptionError if there is no cloth, no table, or only a part
    of the cloth.
    """
    _check_images(rgb, depth, intrinsics)
    source: ColorSource = "given" if color else "learned" if cloth_at else "suggested"
    if color is None:
        color = learn_hsv(rgb, cloth_at) if cloth_at else suggest_hsv(rgb, _near_table(depth, intrinsics, rng))
    config = _scaled_config(intrinsics.width, color, contact_height_m)
    alike = segment(rgb, color, config.min_area_px)
    cloth = _main_piece(alike, cloth_at)
    if not cloth.any():
        raise PerceptionError(
            f"no cloth: no piece of the image has a hue of {color.hue_min:g} to {color.hue_max:g} degrees with a "
            f"saturation from {color.saturation_min:g} and a value from {color.value_min:g}"
        )
    plane = fit_table_plane(depth, intrinsics, rng=rng, cloth=cloth)
    camera = plane.camera(intrinsics)
    _check_on_table(plane, cloth, camera.height_above_table(depth))
    config = replace(config, grid=grid_around(camera, cloth))
    pipeline = PerceptionPipeline(camera, config, flat_pixels)
    alone = np.where((alike & ~cloth)[..., None], np.uint8(0), rgb)  # black is in no range
    state, view = pipeline.perceive(alone, depth), pipeline.cloth_view(alone, depth)
    if view is None or state.out_of_view:
        raise PerceptionError(
            "the cloth is cut by the image's border; move the camera or the cloth so that all is seen"
        )
    return FrameResult(
        cloth_state=state,
        camera=camera,
        plane=plane,
        config=config,
        color_source=source,
        cloth_mask=cloth,
        view=view,
        warnings=tuple(_warnings(alike, cloth, depth, plane, config)),
    )


def _scaled_config(width: int, color: HsvRange, contact_height_m: float) -> PerceptionConfig:
    scale = max(1.0, width / REFERENCE_WIDTH)
    return PerceptionConfig(
        color=color,
        contact_height_m=contact_height_m,
        smoothing_px=2 * round(PerceptionConfig.smoothing_px * scale / 2 - 0.5) + 1,
        min_area_px=round(PerceptionConfig.min_area_px * scale**2),
    )


def _check_images(rgb: RgbArray, depth: FloatArray, intrinsics: Intrinsics) -> None:
    expected = (intrinsics.height, intrinsics.width)
    if rgb.shape != (*expected, 3) or rgb.dtype != np.uint8 or depth.shape != expected:
        raise PerceptionError(
            f"rgb is {rgb.dtype} of shape {rgb.shape} and depth of shape {depth.shape}; "
            f"this camera gives uint8 of {(*expected, 3)} and {expected}"
        )
    valid = depth[(depth > 0) & (depth < np.inf)]
    if len(valid) == 0:
        raise PerceptionError("the depth image has no value at all; is it the right file, and was the sensor covered?")
    middle = float(np.median(valid))
    if not TABLE_RANGE_M[0] < middle < TABLE_RANGE_M[1]:
        raise PerceptionError(
            f"half of the depth image is {'nearer' if middle < 1 else 'farther'} than {middle:.3g} m; a table is seen "
            f"from {TABLE_RANGE_M[0]} to {TABLE_RANGE_M[1]} m: what is the depth's unit?"
        )


def _check_on_table(plane: TablePlane, cloth: BoolArray, height: Float32Array) -> None:
    """Raise PerceptionError unless the table is in range and the cloth is on this table or above it."""
    if not TABLE_RANGE_M[0] * 0.5 < plane.distance_m < TABLE_RANGE_M[1]:
        below = f"{plane.distance_m:.3g} m below the camera"
        raise PerceptionError(f"the table would be {below}; do the depth's unit and the intrinsics fit it?")
    known = ~np.isnan(height[cloth])
    if known.mean() < MIN_DEPTH_SHARE:
        raise PerceptionError(
            f"{100 * known.mean():.0f} % of the cloth has a depth, at least {100 * MIN_DEPTH_SHARE:.0f} % are needed; "
            "light it better, or move the camera nearer or farther"
        )
    middle = float(np.median(height[cloth][known]))
    if middle < SUNKEN_M:
        raise PerceptionError(
            f"the cloth lies {-1000 * middle:.0f} mm below the table that was found around it; "
            "is that range of colour the cloth's, and is the table in view?"
        )


def _near_table(depth: FloatArray, intrinsics: Intrinsics, rng: np.random.Generator) -> BoolArray | None:
    """Return where a cloth can be; None if no plane is found without knowing the cloth."""
    try:
        height = fit_table_plane(depth, intrinsics, rng=rng).camera(intrinsics).height_above_table(depth)
    except PerceptionError:
        return None
    return np.isnan(height) | (height > ON_TABLE_M[0]) & (height < ON_TABLE_M[1])


def _main_piece(mask: BoolArray, at: tuple[int, int] | None) -> BoolArray:
    """Return the piece at ``at``, or the largest, with what is near it; other things may have the cloth's colour."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    if count == 1:
        return mask
    main = 0 if at is None else int(labels[at[1], at[0]])
    main = main or int(np.argmax(areas))
    reach = max(1, round(PIECE_GAP * float(np.sqrt(areas[main]))))
    gap = cv2.distanceTransform((labels != main).astype(np.uint8), cv2.DIST_L2, 3)
    near = np.unique(labels[mask & (gap <= reach)])
    return np.isin(labels, near[areas[near] >= PIECE_SHARE * areas[main]])


def _warnings(
    alike: BoolArray, cloth: BoolArray, depth: FloatArray, plane: TablePlane, config: PerceptionConfig
) -> Iterator[str]:
    if np.count_nonzero(alike & ~cloth):
        yield "other things in the picture have the cloth's colour; the piece that was taken is outlined in the overlay"
    if touches_border(cloth):
        yield "a lifted part of the cloth leaves the picture"
    if plane.rms_m > NOISY_SHARE * config.contact_height_m:
        yield (
            f"the table's depth scatters by {1000 * plane.rms_m:.1f} mm, much for a contact height of "
            f"{1000 * config.contact_height_m:g} mm: move the camera nearer"
        )
    holes = 1 - np.count_nonzero(depth[cloth] > 0) / np.count_nonzero(cloth)
    if holes > HOLES_SHARE:
        yield f"{100 * holes:.0f} % of the cloth has no depth and was filled from its neighbours"
    if config.grid.mm_per_px > TableGrid.mm_per_px:
        yield f"the cloth is so large that a pixel is {config.grid.mm_per_px:g} mm: flat pixels of others do not fit"
