"""One RGB-D frame of a camera whose place nobody knows: color, table and pose from the frame, then its ClothState."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import FloatArray, PinholeCamera
from layflat.perception.camera.rectified_view import BoolArray, ClothView, grid_around, touches_border
from layflat.perception.camera.table_plane import TablePlane, fit_table_plane
from layflat.perception.cloth.color_calibration import learn_hsv, suggest_hsv
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.perception.errors import PerceptionError

ColorSource: TypeAlias = Literal["given", "learned", "suggested"]

TABLE_RANGE_M = (0.15, 6.0)
"""Distances of a table that a camera of the D4xx kind can see cloth on; outside, the unit of the depth is wrong."""
ON_TABLE_M = (-0.03, 0.6)
"""Heights above the table where a cloth is looked for when its colour is not known."""
SUNKEN_M = -0.02
"""A cloth of which most lies lower than this lies on something else than the plane that was found."""
DETAIL_WIDTH = 320
"""Image width that the perceiver's lengths in camera pixels are meant for; they grow with the image."""
PIECE_SHARE = 0.02
"""A piece of the cloth's colour counts as cloth from this share of the main piece on ..."""
PIECE_GAP = 0.12
"""... if its gap to the main piece is at most this share of the main piece's side (something lies across the cloth)."""
NOISY_SHARE = 0.5
"""Contact is uncertain where the depth scatters by more than this share of the contact height."""
LEAST_SEEN = 0.2
"""Share of the cloth that must have a depth."""
HOLES_SHARE = 0.3
"""So it is where more of the cloth than this has no depth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameResult:
    """A frame, what was found out about its camera, and what it says about the cloth."""

    cloth_state: ClothState
    """In table coordinates that are the image's: x right, y up (``TablePlane.camera``)."""
    camera: PinholeCamera
    plane: TablePlane
    config: PerceptionConfig
    """With the cloth's color, and lengths that fit the picture's size."""
    color_source: ColorSource
    cloth: BoolArray
    """(H, W) of the image: what was taken for the cloth."""
    view: ClothView
    """What a descriptor is given."""
    warnings: tuple[str, ...]
    """What makes the numbers less certain, a sentence each."""


def analyze_frame(
    rgb: NDArray[np.uint8],
    depth: FloatArray,
    lens: Intrinsics,
    *,
    color: HsvRange | None = None,
    cloth_at: tuple[int, int] | None = None,
    contact_height_m: float = PerceptionConfig.contact_height_m,
    flat_pixels: int | None = None,
    rng: np.random.Generator,
) -> FrameResult:
    """Image (H, W, 3) uint8 and aligned depth (H, W) m, 0 where missing -> FrameResult.

    The cloth's ``colour`` is given, learned around pixel ``cloth_at`` (column, row), or suggested. PerceptionError
    where there is no cloth, no table, or only part of the cloth.
    """
    _check(rgb, depth, lens)
    source: ColorSource = "given" if color else "learned" if cloth_at else "suggested"
    if color is None:
        color = learn_hsv(rgb, cloth_at) if cloth_at else suggest_hsv(rgb, _on_table(depth, lens, rng))
    scale = max(1.0, lens.width / DETAIL_WIDTH)
    min_area_px = round(PerceptionConfig.min_area_px * scale**2)
    found = segment(rgb, color, min_area_px)
    cloth = _one_cloth(found, cloth_at)
    if not cloth.any():
        raise PerceptionError(
            f"no cloth: no piece of the image has a hue of {color.hue_min:g} to {color.hue_max:g} degrees with a "
            f"saturation from {color.saturation_min:g} and a value from {color.value_min:g}"
        )
    plane = fit_table_plane(depth, lens, rng=rng, cloth=cloth)
    _check_distance(plane)
    camera = plane.camera(lens)
    config = PerceptionConfig(
        color=color,
        grid=grid_around(camera, cloth),
        contact_height_m=contact_height_m,
        smoothing_px=2 * round(PerceptionConfig.smoothing_px * scale / 2 - 0.5) + 1,
        min_area_px=min_area_px,
    )
    height = camera.height_above_table(depth)
    _check_lies(cloth, height)
    perceiver = PerceptionPipeline(camera, config, flat_pixels)
    alone = _without(rgb, found & ~cloth)
    cloth_state, view = perceiver.perceive(alone, depth), perceiver.cloth_view(alone, depth)
    if view is None or cloth_state.out_of_view:
        raise PerceptionError(
            "the cloth is cut by the image's border; move the camera or the cloth so that all is seen"
        )
    return FrameResult(
        cloth_state=cloth_state,
        camera=camera,
        plane=plane,
        config=config,
        color_source=source,
        cloth=cloth,
        view=view,
        warnings=tuple(_warnings(found, cloth, depth, plane, config)),
    )


def _check(rgb: NDArray[np.uint8], depth: FloatArray, lens: Intrinsics) -> None:
    wanted = (lens.height, lens.width)
    if rgb.shape != (*wanted, 3) or rgb.dtype != np.uint8 or depth.shape != wanted:
        raise PerceptionError(
            f"rgb is {rgb.dtype} of shape {rgb.shape} and depth of shape {depth.shape}; "
            f"this camera gives uint8 of {(*wanted, 3)} and {wanted}"
        )
    seen = depth[(depth > 0) & (depth < np.inf)]
    if len(seen) == 0:
        raise PerceptionError("the depth image has no value at all; is it the right file, and was the sensor covered?")
    middle = float(np.median(seen))
    if not TABLE_RANGE_M[0] < middle < TABLE_RANGE_M[1]:
        raise PerceptionError(
            f"half of the depth image is {'nearer' if middle < 1 else 'farther'} than {middle:.3g} m; a table is seen "
            f"from {TABLE_RANGE_M[0]} to {TABLE_RANGE_M[1]} m: what is the depth's unit?"
        )


def _check_distance(plane: TablePlane) -> None:
    if not TABLE_RANGE_M[0] * 0.5 < plane.distance_m < TABLE_RANGE_M[1]:
        raise PerceptionError(
            f"the table would be {plane.distance_m:.3g} m below the camera; "
            "do the depth's unit and the intrinsics fit it?"
        )


def _check_lies(cloth: BoolArray, height: NDArray[np.float32]) -> None:
    """The cloth is on this table or above it."""
    known = ~np.isnan(height[cloth])
    if known.mean() < LEAST_SEEN:
        raise PerceptionError(
            f"{100 * known.mean():.0f} % of the cloth has a depth, at least {100 * LEAST_SEEN:.0f} % are needed; "
            "light it better, or move the camera nearer or farther"
        )
    middle = float(np.median(height[cloth][known]))
    if middle < SUNKEN_M:
        raise PerceptionError(
            f"the cloth lies {-1000 * middle:.0f} mm below the table that was found around it; "
            "is that range of colour the cloth's, and is the table in view?"
        )


def _on_table(depth: FloatArray, lens: Intrinsics, rng: np.random.Generator) -> BoolArray | None:
    """Where a cloth can be; None where no plane is found without knowing the cloth."""
    try:
        height = fit_table_plane(depth, lens, rng=rng).camera(lens).height_above_table(depth)
    except PerceptionError:
        return None
    near = (height > ON_TABLE_M[0]) & (height < ON_TABLE_M[1])
    return near | np.isnan(height)


def _one_cloth(mask: BoolArray, at: tuple[int, int] | None) -> BoolArray:
    """The piece at ``at``, or else the largest, with what is near it; other things may have the cloth's color."""
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


def _without(rgb: NDArray[np.uint8], dropped: BoolArray) -> NDArray[np.uint8]:
    """The image with what is dropped black, which no range takes for cloth."""
    if not dropped.any():
        return rgb
    kept = rgb.copy()
    kept[dropped] = 0
    return kept


def _warnings(
    found: BoolArray, cloth: BoolArray, depth: FloatArray, plane: TablePlane, config: PerceptionConfig
) -> Iterator[str]:
    if np.count_nonzero(found & ~cloth):
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
    if config.grid.mm_per_px > PerceptionConfig().grid.mm_per_px:
        yield f"the cloth is so large that a pixel is {config.grid.mm_per_px:g} mm: flat pixels of others do not fit"
