"""Images that descriptors filter: the cloth's brightness without its outline, and the pixels that count."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, RgbArray, dilate, erode
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.errors import PerceptionError

MIN_LOCAL_BRIGHTNESS = np.float32(0.05)
"""Local mean of the relative brightness below which a ratio to it would be noise."""


@dataclass(frozen=True, kw_only=True)
class PreprocessConfig:
    """Settings of ``preprocess``, with WORD's defaults. Lengths are on the cloth, independent of the resolution."""

    decimation: int = 2
    """Pixels that are averaged into one, along each axis."""
    fill_reach_mm: float = 58.0
    """The outside is filled with the mean brightness of the cloth within about this distance."""
    erosion_mm: float = 14.0
    """Pixels this close to the silhouette's edge do not count for a direction."""
    near_contact_mm: float = 25.0
    """Nor do pixels farther than this from the contact (the flanks of a wrinkle are not in contact)."""
    max_height_m: float = 0.03
    """Nor do higher ones."""
    min_area_mm2: float = 2500.0
    """Smallest area of cloth that has a direction."""

    def __post_init__(self) -> None:
        if self.decimation < 1:
            raise PerceptionError(f"decimation is {self.decimation}; at least 1 is needed")
        if min(self.fill_reach_mm, self.erosion_mm, self.near_contact_mm, self.min_area_mm2) < 0:
            raise PerceptionError(f"{self}: distances and areas must not be negative")


@dataclass(frozen=True, kw_only=True, eq=False)
class PreprocessedImage:
    """A view ready for filters; all arrays (h, w)."""

    image: Float32Array
    """Brightness relative to the cloth's mean, so that the exposure cancels, without an edge at the silhouette."""
    cloth: BoolArray
    valid: BoolArray
    """Pixels that count for a direction; none if they cover less than ``min_area_mm2``."""
    mm_per_px: float


def preprocess(view: ClothView, config: PreprocessConfig) -> PreprocessedImage | None:
    """Return the view ready for filters; None without cloth."""
    image, cloth, contact, height = _decimate(view, config.decimation)
    if not cloth.any():
        return None
    mm_per_px = view.mm_per_px * config.decimation
    valid = erode(cloth, config.erosion_mm / mm_per_px)
    valid &= dilate(contact, config.near_contact_mm / mm_per_px) & (height <= config.max_height_m)
    if np.count_nonzero(valid) * mm_per_px**2 < config.min_area_mm2:
        valid = np.zeros_like(valid)
    filled = fill_holes(image, erode(cloth, 1.0), config.fill_reach_mm / mm_per_px, background=1.0)
    return PreprocessedImage(image=filled, cloth=cloth, valid=valid, mm_per_px=mm_per_px)


def _decimate(view: ClothView, factor: int) -> tuple[Float32Array, BoolArray, BoolArray, Float32Array]:
    """Return relative brightness, cloth, contact and height, each averaged over ``factor`` squared pixels."""
    image = relative_brightness(view.rgb, view.cloth)
    if factor == 1:
        return image, view.cloth, view.contact, view.height
    size = (-(-view.cloth.shape[1] // factor), -(-view.cloth.shape[0] // factor))

    def average(array: Float32Array) -> Float32Array:
        return np.asarray(cv2.resize(array, size, interpolation=cv2.INTER_AREA), dtype=np.float32)

    cloth, contact = (average(mask.astype(np.float32)) > 0.5 for mask in (view.cloth, view.contact))
    return average(image), cloth, contact, average(view.height)


def relative_brightness(rgb: RgbArray, cloth: BoolArray) -> Float32Array:
    """Return (h, w) each pixel's share along the cloth's mean colour; 1 on average over the cloth.

    For a cloth of one colour this is the grey image with the least noise, for any colour.
    """
    color = np.array(cv2.mean(rgb, cloth.view(np.uint8))[:3])
    power = float(color @ color)
    if power == 0.0:
        return np.ones(cloth.shape, dtype=np.float32)
    return np.asarray(cv2.transform(rgb.astype(np.float32), (color / power)[None, :]), dtype=np.float32)


def fill_holes(image: Float32Array, inside: BoolArray, reach_px: float, background: float) -> Float32Array:
    """Fill the outside with the mean of what is inside within about ``reach_px``, or ``background`` where none is.

    The outline of the cloth is then not a wrinkle.
    """
    share, mean = _box_means(inside, image - np.float32(background), reach_px)
    outside = np.float32(background) + mean / np.maximum(share, np.float32(1e-3))
    return np.where(inside, image, outside).astype(np.float32)


def local_contrast(image: Float32Array, inside: BoolArray, reach_px: float, max_contrast: float) -> Float32Array:
    """Return the image over its mean within about ``reach_px``, cut at 1 +- ``max_contrast``; 1 outside.

    The edge of a shadow is then no stronger than the wrinkles, and neither is glare or the outline.
    """
    share, mean = _box_means(inside, image, reach_px)
    # Image / local mean = image * share / mean; a black cloth has no contrast.
    ratio = image * share / np.maximum(mean, MIN_LOCAL_BRIGHTNESS * share + np.float32(1e-6))
    return np.where(inside, np.clip(ratio, 1 - max_contrast, 1 + max_contrast), np.float32(1)).astype(np.float32)


def _box_means(inside: BoolArray, image: Float32Array, reach_px: float) -> tuple[Float32Array, Float32Array]:
    """Return the box means of ``inside`` and of the image with 0 outside."""
    box = (2 * round(reach_px / 2) + 1,) * 2
    masked = np.where(inside, image, np.float32(0))
    share, mean = (
        np.asarray(cv2.boxFilter(array, -1, box, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)
        for array in (inside.astype(np.float32), masked)
    )
    return share, mean
