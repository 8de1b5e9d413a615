"""What descriptors of wrinkles look at: the cloth's brightness without its outline, and which pixels of it count."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.rectified_view import BoolArray, ClothView
from layflat.perception.errors import PerceptionError

DARKEST = np.float32(0.05)
"""Local mean of the relative brightness below which a ratio to it would be noise."""


@dataclass(frozen=True, kw_only=True)
class PreprocessConfig:
    """Lengths on the cloth, so that they mean the same at each resolution. The defaults are those of WORD."""

    decimation: int = 2
    """Table pixels that are averaged into one, along each axis."""
    fill_reach_mm: float = 58.0
    """Outside the silhouette stands the mean brightness of the cloth within about this distance."""
    erosion_mm: float = 14.0
    """Pixels this close to the silhouette's edge do not count for a direction."""
    near_contact_mm: float = 25.0
    """Nor do those farther than this from the contact (the flanks of a wrinkle are not in contact)."""
    max_height_m: float = 0.03
    """Nor those where the cloth is higher than this."""
    min_area_mm2: float = 2500.0
    """There is no direction on less cloth than this."""

    def __post_init__(self) -> None:
        if self.decimation < 1:
            raise PerceptionError(f"decimation is {self.decimation}; at least 1 is needed")
        if min(self.fill_reach_mm, self.erosion_mm, self.near_contact_mm, self.min_area_mm2) < 0:
            raise PerceptionError(f"{self}: distances and areas must not be negative")


@dataclass(frozen=True, kw_only=True, eq=False)
class PreprocessedImage:
    """One view, ready for filters; all arrays (h, w)."""

    image: NDArray[np.float32]
    """Brightness relative to the cloth's mean, so that the exposure cancels; no edge at the silhouette."""
    cloth: BoolArray
    lying: BoolArray
    """Where a direction may come from; nowhere if that is less than ``min_area_mm2``."""
    mm_per_px: float


def preprocess(view: ClothView, config: PreprocessConfig) -> PreprocessedImage | None:
    """None for a view without cloth."""
    image, cloth, contact, height = _reduced(view, config.decimation)
    if not cloth.any():
        return None
    mm_per_px = view.mm_per_px * config.decimation
    lying = eroded(cloth, config.erosion_mm / mm_per_px)
    lying &= dilated(contact, config.near_contact_mm / mm_per_px) & (height <= config.max_height_m)
    if np.count_nonzero(lying) * mm_per_px**2 < config.min_area_mm2:
        lying = np.zeros_like(lying)
    bare = fill_holes(image, eroded(cloth, 1.0), config.fill_reach_mm / mm_per_px, beyond=1.0)
    return PreprocessedImage(image=bare, cloth=cloth, lying=lying, mm_per_px=mm_per_px)


def _reduced(view: ClothView, decimation: int) -> tuple[NDArray[np.float32], BoolArray, BoolArray, NDArray[np.float32]]:
    """Relative brightness, cloth, contact and height, each averaged over ``decimation`` squared pixels."""
    image = relative_brightness(view.rgb, view.cloth)
    if decimation == 1:
        return image, view.cloth, view.contact, view.height
    size = (-(-view.cloth.shape[1] // decimation), -(-view.cloth.shape[0] // decimation))

    def average(array: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(array, size, interpolation=cv2.INTER_AREA), dtype=np.float32)

    cloth, contact = (average(mask.astype(np.float32)) > 0.5 for mask in (view.cloth, view.contact))
    return average(image), cloth, contact, average(view.height)


def relative_brightness(rgb: NDArray[np.uint8], cloth: BoolArray) -> NDArray[np.float32]:
    """(h, w): each pixel's share along the cloth's mean colour; 1 on average over the cloth.

    For a cloth of one colour this is the grey image with the least noise, whatever the colour.
    """
    colour = np.array(cv2.mean(rgb, cloth.view(np.uint8))[:3])
    power = float(colour @ colour)
    if power == 0.0:
        return np.ones(cloth.shape, dtype=np.float32)
    return np.asarray(cv2.transform(rgb.astype(np.float32), (colour / power)[None, :]), dtype=np.float32)


def fill_holes(image: NDArray[np.float32], inside: BoolArray, reach_px: float, beyond: float) -> NDArray[np.float32]:
    """The image inside; outside, the mean of what is inside within about ``reach_px``, or ``beyond`` where none is.

    So that the outline of the cloth is not a wrinkle.
    """
    box = (2 * round(reach_px / 2) + 1,) * 2
    share = cv2.boxFilter(inside.astype(np.float32), -1, box, borderType=cv2.BORDER_CONSTANT)
    less = image - np.float32(beyond)
    mean = cv2.boxFilter(np.where(inside, less, np.float32(0)), -1, box, borderType=cv2.BORDER_CONSTANT)
    outside = np.float32(beyond) + mean / np.maximum(share, np.float32(1e-3))
    return np.where(inside, image, outside).astype(np.float32)


def local_contrast(image: NDArray[np.float32], inside: BoolArray, reach_px: float, most: float) -> NDArray[np.float32]:
    """The image over its mean within about ``reach_px``, cut at 1 +- ``most``; 1 outside, so that no outline is seen.

    The edge of a shadow then is no more than the wrinkles are, and neither is a glare.
    """
    box = (2 * round(reach_px / 2) + 1,) * 2
    share = cv2.boxFilter(inside.astype(np.float32), -1, box, borderType=cv2.BORDER_CONSTANT)
    total = cv2.boxFilter(np.where(inside, image, np.float32(0)), -1, box, borderType=cv2.BORDER_CONSTANT)
    # Image / mean = image * share / total; a black cloth has no contrast.
    ratio = image * share / np.maximum(total, DARKEST * share + np.float32(1e-6))
    return np.where(inside, np.clip(ratio, 1 - most, 1 + most), np.float32(1)).astype(np.float32)


def eroded(mask: BoolArray, radius_px: float) -> BoolArray:
    """Without the pixels nearer than ``radius_px`` to the outside or to the view's border."""
    if round(radius_px) == 0:
        return mask
    return cv2.erode(mask.view(np.uint8), _disc(radius_px), borderType=cv2.BORDER_CONSTANT, borderValue=0).view(
        np.bool_
    )


def dilated(mask: BoolArray, radius_px: float) -> BoolArray:
    """With the pixels nearer than ``radius_px`` to it."""
    if round(radius_px) == 0:
        return mask
    return cv2.dilate(mask.view(np.uint8), _disc(radius_px)).view(np.bool_)


def _disc(radius_px: float) -> NDArray[np.uint8]:
    side = 2 * round(radius_px) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), dtype=np.uint8)
