"""Which pixels of a frame are the cloth: by a mask, its colour, a point on it, or as what stands out from the table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, FloatArray, RgbArray
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.cloth.color_calibration import learn_hsv, name_color, range_of_cloth
from layflat.perception.cloth.finder import Finding, find_cloth
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.perception.cloth.table_scene import fill_holes
from layflat.perception.errors import ClothRefusedError, PerceptionError

ClothSource: TypeAlias = Literal["given", "learned", "suggested", "mask"]

REFERENCE_WIDTH = 320
"""Image width that PerceptionConfig's camera pixels are meant for; they are scaled to the image."""
PIECE_SHARE, PIECE_GAP = 0.02, 0.12
"""Smallest piece of the cloth's colour that belongs to the cloth, share of the main piece; largest gap between them
(something lies across the cloth), share of its side."""
ALIKE_SHARE = 0.05
"""Other things of the cloth's colour are mentioned from this share of its area."""
PATCH_SHARE = 0.6
"""What covers less of the surface that it is a part of is only a patch of it."""
FAR_M = 1.6
"""A table this far away is unusual: the unit of the depth may be wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenCloth:
    """The pixels of the cloth, and how they were found."""

    mask: BoolArray
    """(H, W)."""
    source: ClothSource
    color: HsvRange | None
    """Range of colour that finds the same cloth; None if there is none."""
    color_name: str
    warnings: tuple[str, ...] = ()


def take_cloth(
    rgb: RgbArray,
    depth: FloatArray,
    intrinsics: Intrinsics,
    *,
    rng: np.random.Generator,
    color: HsvRange | None = None,
    at: tuple[int, int] | None = None,
    mask: BoolArray | None = None,
) -> TakenCloth:
    """Return the cloth by ``mask``, by ``color``, around pixel ``at`` (column, row), or as what stands out.

    ClothRefusedError where that is no whole cloth.
    """
    if mask is not None:
        if mask.shape != depth.shape or not mask.any():
            raise PerceptionError(f"the mask has shape {mask.shape} and {np.count_nonzero(mask)} pixels of cloth")
        return _describe(rgb, mask, "mask")
    if color is not None:
        finding = _find_or_none(rgb, depth, intrinsics, rng)
        return _by_color(rgb, color, at, "given", finding)
    if at is not None:
        if not (0 <= at[0] < intrinsics.width and 0 <= at[1] < intrinsics.height):
            size = f"{intrinsics.width}x{intrinsics.height} px"
            raise PerceptionError(f"point {at[0]},{at[1]} is outside the image, which is {size}")
        return _around(rgb, at, _find_or_none(rgb, depth, intrinsics, rng))
    return _standing_out(rgb, find_cloth(rgb, depth, intrinsics, rng=rng))


def scaled_area(area_px: float, width: int) -> int:
    """Return the pixels of an image of ``width`` that show what ``area_px`` do at REFERENCE_WIDTH."""
    return round(area_px * max(1.0, width / REFERENCE_WIDTH) ** 2)


def far_hint(distance_m: float) -> str:
    """Return a question about the depth's unit where the table is unusually far."""
    far = f" (the table would be {distance_m:.1f} m away: is --depth-scale the depth's unit?)"
    return far if distance_m > FAR_M else ""


def _find_or_none(rgb: RgbArray, depth: FloatArray, intrinsics: Intrinsics, rng: np.random.Generator) -> Finding | None:
    try:
        return find_cloth(rgb, depth, intrinsics, rng=rng)
    except PerceptionError:
        return None


def _standing_out(rgb: RgbArray, finding: Finding) -> TakenCloth:
    cloths = finding.cloths()
    if len(cloths) > 1:
        places = " and ".join(f"{x},{y}" for x, y in (finding.middle(piece) for piece in cloths[:2]))
        raise ClothRefusedError(
            f"{len(cloths)} things could be the cloth, at {places}: point at one with --cloth-at X,Y",
            finding.enlarge(np.logical_or.reduce([piece.mask for piece in cloths])),
        )
    if cloths:
        mask = finding.outline(cloths[0])
        if not finding.is_patch(mask):
            return _describe(rgb, mask, "suggested")
        raise ClothRefusedError(
            f"what stands out ({name_color(rgb, mask)}) is only a patch: around it are the same colour and height; "
            f"{_OTHER_WAYS}",
            mask,
        )
    hint = far_hint(finding.distance_m)
    cut = next((piece for piece in finding.pieces if not piece.doubt), None)
    if cut is not None:
        whole = finding.enlarge(cut.mask)
        raise ClothRefusedError(cut_by_border(name_color(rgb, whole)) + hint, whole)
    if not finding.pieces:
        raise ClothRefusedError(
            f"no cloth stands out from the table; {_OTHER_WAYS}{hint}", np.zeros(finding.shape, bool)
        )
    largest = finding.pieces[0]
    whole = finding.enlarge(largest.mask)
    raise ClothRefusedError(
        f"no cloth stands out: the largest thing on the table ({name_color(rgb, whole)}) is none, "
        f"{largest.doubt}; {_OTHER_WAYS}{hint}",
        whole,
    )


_OTHER_WAYS = "if there is one, point at it with --cloth-at X,Y or give --mask"


def cut_by_border(name: str) -> str:
    """Return the refusal of a cloth that is not seen whole."""
    return f"the {name} cloth is cut by the image's border; move the camera or the cloth so that all is seen"


def _around(rgb: RgbArray, at: tuple[int, int], finding: Finding | None) -> TakenCloth:
    piece = None if finding is None else finding.at(at)
    if finding is None or piece is None:
        return _by_color(rgb, learn_hsv(rgb, at), at, "learned", finding)
    mask = finding.outline(piece)
    if not mask[at[1], at[0]]:
        mask = finding.enlarge(piece.mask)
    doubts = (f"what is at {at[0]},{at[1]} may be no cloth: {piece.doubt}",) if piece.doubt else ()
    return _describe(rgb, mask, "learned", doubts)


def _by_color(
    rgb: RgbArray, color: HsvRange, at: tuple[int, int] | None, source: ClothSource, finding: Finding | None
) -> TakenCloth:
    alike = segment(rgb, color, scaled_area(40, rgb.shape[1]))
    if not alike.any():
        raise PerceptionError(
            f"no cloth: no piece of the image has a hue of {color.hue_min:g} to {color.hue_max:g} degrees with a "
            f"saturation from {color.saturation_min:g} and a value from {color.value_min:g}"
        )
    mask = fill_holes(_main_piece(alike, at))
    piece = None if finding is None else finding.containing(mask)
    if finding is not None and piece is not None and piece.cloth_like:
        whole = finding.outline(piece)
        share = float(np.sum(mask & whole) / max(1, int(whole.sum())))
        if share < PATCH_SHARE:
            raise ClothRefusedError(
                f"what has this colour ({name_color(rgb, mask)}) is only a patch, {100 * share:.0f} % of the "
                f"{name_color(rgb, whole)} cloth around it; leave the colour out, or give --mask",
                mask,
            )
    doubt = "" if finding is None else finding.doubt_about(mask)
    doubts = [f"what has this colour may be no cloth: {doubt}"] if doubt else []
    others = np.count_nonzero(alike & ~mask)
    if others:
        doubts.insert(
            0,
            "other things in the picture have the cloth's colour; the piece that was taken is outlined in the overlay",
        )
    return TakenCloth(mask=mask, source=source, color=color, color_name=name_color(rgb, mask), warnings=tuple(doubts))


def _describe(rgb: RgbArray, mask: BoolArray, source: ClothSource, warnings: tuple[str, ...] = ()) -> TakenCloth:
    """Return a cloth with the range of colour that finds it, where there is one."""
    color = range_of_cloth(rgb, mask)
    if color is not None and source != "mask":
        alike = segment(rgb, color, scaled_area(40, rgb.shape[1]))
        if np.count_nonzero(alike & ~mask) > ALIKE_SHARE * np.count_nonzero(mask):
            warnings = (*warnings, "other things in the picture have the cloth's colour; see what the overlay outlines")
    return TakenCloth(mask=mask, source=source, color=color, color_name=name_color(rgb, mask), warnings=warnings)


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
