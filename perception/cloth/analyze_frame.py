"""State of the cloth in one RGB-D frame of an unknown camera: colour, table and pose come from the frame itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, FloatArray, RgbArray, touches_border
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.camera.table_grid import TableGrid, grid_around
from layflat.perception.camera.table_plane import TablePlane, fit_table_plane
from layflat.perception.cloth.contact import SUNKEN_M as IMPOSSIBLE_M
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.cloth.take_cloth import (
    FAR_M,
    REFERENCE_WIDTH,
    ClothSource,
    TakenCloth,
    cut_by_border,
    scaled_area,
    take_cloth,
)
from layflat.perception.errors import ClothRefusedError, PerceptionError

TABLE_RANGE_M = (0.15, 6.0)
"""Distances from which a D4xx camera sees cloth on a table; outside, the unit of the depth is wrong."""
MAX_DEPTH_M = 10.0
"""Farther values are no depth; 65.535 m is a usual mark for a missing one."""
SUNKEN_M = -0.02
"""A cloth mostly below this lies on something else than the fitted plane."""
NOISY_SHARE, HOLES_SHARE = 0.5, 0.3
"""Warn where the depth scatters by more than this share of the contact height, or is missing on more of the cloth."""
MIN_DEPTH_SHARE = 0.2
"""Share of the cloth that must have a depth."""
LARGE_M2, NO_CONTACT_SHARE = 0.5, 0.05
"""A cloth larger than this, on a table farther than FAR_M, with less contact: the unit of the depth is wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameResult:
    """State of the cloth in a frame, and what was inferred about the camera."""

    cloth_state: ClothState
    """In table coordinates that are the image's: x right, y up (``TablePlane.camera``)."""
    camera: PinholeCamera
    plane: TablePlane
    config: PerceptionConfig
    """Settings, with lengths scaled to the image."""
    color: HsvRange | None
    """Range of colour that finds this cloth; None if there is none (white, grey, black, printed)."""
    color_name: str
    color_source: ClothSource
    """How the cloth was found."""
    cloth_mask: BoolArray
    """(H, W) pixels of the image that were taken for the cloth."""
    depth: Float32Array
    """(H, W) m, 0 where missing or impossible."""
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
    mask: BoolArray | None = None,
    contact_height_m: float = PerceptionConfig.contact_height_m,
    flat_pixels: int | None = None,
    rng: np.random.Generator,
) -> FrameResult:
    """Estimate the cloth's state from ``rgb`` (H, W, 3) uint8 and ``depth`` (H, W) m along the axis, 0 if missing.

    The cloth is what ``mask`` (H, W) says, has ``color``, is at ``cloth_at`` (column, row), or stands out from the
    table. ``rng`` draws the pixels and trials of the plane fit. PerceptionError says what cannot be seen;
    ClothRefusedError also holds what was found instead of a whole cloth.
    """
    _check_images(rgb, depth, intrinsics)
    depth = np.where((depth > 0) & (depth < MAX_DEPTH_M), depth, 0).astype(np.float32)
    cloth = take_cloth(rgb, depth, intrinsics, rng=rng, color=color, at=cloth_at, mask=mask)
    plane = fit_table_plane(depth, intrinsics, rng=rng, cloth=cloth.mask)
    camera = plane.camera(intrinsics)
    height = camera.height_above_table(depth)
    _check_on_table(plane, cloth.mask, height)
    depth = np.where(cloth.mask & (height < IMPOSSIBLE_M), np.float32(0), depth)
    config = _scaled_config(intrinsics.width, cloth.color, contact_height_m)
    config = replace(config, grid=grid_around(camera, cloth.mask))
    state, view = PerceptionPipeline(camera, config, flat_pixels).see(rgb, depth, cloth.mask)
    if view is None or state.out_of_view:
        raise ClothRefusedError(cut_by_border(cloth.color_name), cloth.mask)
    _check_unit(plane, state, cloth.mask)
    return FrameResult(
        cloth_state=state,
        camera=camera,
        plane=plane,
        config=config,
        color=cloth.color,
        color_name=cloth.color_name,
        color_source=cloth.source,
        cloth_mask=cloth.mask,
        depth=depth,
        view=view,
        warnings=tuple(_warnings(cloth, depth, height, plane, config)),
    )


def _scaled_config(width: int, color: HsvRange | None, contact_height_m: float) -> PerceptionConfig:
    scale = max(1.0, width / REFERENCE_WIDTH)
    return PerceptionConfig(
        color=HsvRange() if color is None else color,
        contact_height_m=contact_height_m,
        smoothing_px=2 * round(PerceptionConfig.smoothing_px * scale / 2 - 0.5) + 1,
        min_area_px=scaled_area(PerceptionConfig.min_area_px, width),
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


def _check_unit(plane: TablePlane, state: ClothState, mask: BoolArray) -> None:
    """Raise ClothRefusedError where distance, area and contact together say that the unit of the depth is too large."""
    area = state.cloth_pixels * state.grid.metres_per_px**2
    contact = state.contact_pixels / max(state.cloth_pixels, 1)
    if plane.distance_m > FAR_M and area > LARGE_M2 and contact < NO_CONTACT_SHARE:
        raise ClothRefusedError(
            f"a cloth of {area:.1f} m2, {plane.distance_m:.1f} m away, with {100 * contact:.0f} % of it on the table "
            f"and depth that scatters by {1000 * plane.rms_m:.1f} mm: is --depth-scale the depth's unit (0.25 or 0.1)?",
            mask,
        )


def _warnings(
    cloth: TakenCloth, depth: FloatArray, height: Float32Array, plane: TablePlane, config: PerceptionConfig
) -> Iterator[str]:
    yield from cloth.warnings
    if touches_border(cloth.mask):
        yield "a lifted part of the cloth leaves the picture"
    if plane.rms_m > NOISY_SHARE * config.contact_height_m:
        yield (
            f"the table's depth scatters by {1000 * plane.rms_m:.1f} mm, much for a contact height of "
            f"{1000 * config.contact_height_m:g} mm: move the camera nearer"
        )
    holes = 1 - np.count_nonzero(depth[cloth.mask] > 0) / np.count_nonzero(cloth.mask)
    if holes > HOLES_SHARE:
        yield f"{100 * holes:.0f} % of the cloth has no depth and was filled from its neighbours"
    middle, high = np.nanpercentile(height[cloth.mask], [50, 90])
    if 0.5 * config.contact_height_m < middle and config.contact_height_m < high < 2 * config.contact_height_m:
        yield (
            f"the cloth is {1000 * middle:.0f} mm high in the middle and nowhere much higher: if it is thick and lies "
            f"flat, give --contact-mm {1000 * high + 1:.0f}"
        )
    if config.grid.mm_per_px > TableGrid.mm_per_px:
        yield f"the cloth is so large that a pixel is {config.grid.mm_per_px:g} mm: flat pixels of others do not fit"
