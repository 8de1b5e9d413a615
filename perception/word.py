"""WORD, the wrinkle contraction direction: Algorithm 1, Eq. 3-2 and Eq. 3-3 of the thesis, in table coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.descriptor import Direction, axial_mean, wrinkle_normals
from perception.errors import PerceptionError
from perception.gabor import GaborParams, gabor_bank
from perception.tableview import BoolArray, ClothView


@dataclass(frozen=True, kw_only=True)
class WordConfig:
    """How wrinkles are looked for.

    The default wavelength is the shortest wrinkle of a 0.35 m cloth of 13x13 nodes (two cells, 58 mm). With this
    short-tailed an envelope a napkin's 40 mm wrinkle still has 0.74 of the gain, one of 80 mm 0.79, of 116 mm 0.47.
    """

    orientations: int = 8
    """n of Algorithm 1."""
    wavelength: float = 58.0
    sigma: float = 18.0
    gamma: float = 0.3
    psi: float = math.pi / 2
    """Phase of Eq. 3-1's sine, rad; pi/2 makes it even, blind to a slow gradient of the light."""
    kernel_size: float = 75.0
    unit: Literal["mm", "px"] = "mm"
    """Unit of wavelength, sigma and kernel_size: millimetres on the cloth, or pixels of the table view."""
    normalise: bool = True
    """Give every kernel mean 0 and gain 1; False leaves Eq. 3-1 as it stands, which also answers to a flat cloth."""
    fill: bool = True
    """Put the cloth's local mean brightness outside its silhouette, so that its outline is not a wrinkle."""
    erosion_mm: float = 14.0
    """Responses this close to the silhouette's edge do not count."""
    near_contact_mm: float = 25.0
    """Responses farther than this from the contact do not count (the flanks of a wrinkle are not in contact)."""
    max_height_m: float = 0.03
    """Nor do those where the cloth is higher than this."""
    decimation: int = 2
    """Table pixels that are averaged into one, along each axis, before filtering."""
    noise_floor: float = 0.003
    """Strength below which there is no direction, relative brightness. A flat cloth with sensor noise of 3 grey levels
    shows 0.001; wrinkles of 58 mm and 2 mm amplitude 0.06 when lit across, 0.004 when lit along."""
    min_area_mm2: float = 2500.0
    """There is no direction on less cloth than this: about a square of one wavelength."""

    def __post_init__(self) -> None:
        if self.orientations < 2 or self.decimation < 1:
            raise PerceptionError(
                f"orientations is {self.orientations} and decimation {self.decimation}; at least 2 and 1 are needed"
            )
        if min(self.erosion_mm, self.near_contact_mm, self.noise_floor, self.min_area_mm2) < 0:
            raise PerceptionError(f"{self}: distances, areas and the noise floor must not be negative")
        self.gabor(1.0)

    def gabor(self, mm_per_px: float) -> GaborParams:
        """Eq. 3-1's parameters in pixels of ``mm_per_px``."""
        scale = mm_per_px if self.unit == "mm" else 1.0
        return GaborParams(
            wavelength=self.wavelength / scale,
            sigma=self.sigma / scale,
            gamma=self.gamma,
            psi=self.psi,
            size=round(self.kernel_size / scale),
        )

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """(n, 2) v_i of Eq. 3-3, from ``wrinkle_normals``."""
        return wrinkle_normals(self.orientations)


THESIS = WordConfig(
    wavelength=8.0,
    sigma=4.0,
    gamma=0.1,
    psi=10.0,
    kernel_size=12,
    unit="px",
    normalise=False,
    fill=False,
    erosion_mm=0.0,
    near_contact_mm=0.0,
    max_height_m=math.inf,
    decimation=1,
    noise_floor=0.0,
    min_area_mm2=0.0,
)
"""The parameters of figure 3-1 as they are printed: pixels, psi in rad, the contact mask alone.

Strength is then in units of the kernel's sum, and never 0 where there is contact.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Word:
    """WORD and what is known of its worth. Without wrinkles all numbers are 0."""

    direction: NDArray[np.float64]
    """(2,) unit vector in table coordinates (x, y), x >= 0: W of Algorithm 1.

    The plain sum of Eq. 3-3 leans to +x: v_i spans a half circle, so that any response that all orientations share
    adds up to a vector along +x, and wrinkles along x have neighbours that cancel in y.
    """
    axial: NDArray[np.float64]
    """(2,) unit vector, x >= 0: mean axis of the same responses with doubled angles, free of that lean."""
    coherence: float
    """0..1: length of the doubled-angle mean; 1 where all responses are in one orientation, 0 where they are equal."""
    strength: float
    """>= 0: mean |response| of the strongest orientation, as a share of the cloth's mean brightness."""
    weights: NDArray[np.float64]
    """(n,) w of Eq. 3-2, 0..1, for wrinkles at i pi / n from the x axis."""


def wrinkle_sums(view: ClothView, config: WordConfig) -> tuple[NDArray[np.float64], int]:
    """(n,) L of Algorithm 1: sum of |response| where it counts, for each orientation; and the number of those pixels.

    Brightness is relative to the cloth's mean, so that the exposure cancels.
    """
    image, cloth, contact, height = _reduced(view, config.decimation)
    mm_per_px = view.mm_per_px * config.decimation
    counted = _eroded(cloth, config.erosion_mm / mm_per_px)
    counted &= _dilated(contact, config.near_contact_mm / mm_per_px) & (height <= config.max_height_m)
    pixels = int(np.count_nonzero(counted))
    if pixels == 0 or pixels * mm_per_px**2 < config.min_area_mm2:
        return np.zeros(config.orientations), 0
    params = config.gabor(mm_per_px)
    if config.fill:
        image = _filled(image, _eroded(cloth, 1.0), params.wavelength)
    # A wrinkle's normal v is at atan2(vy, vx) in the table's axes; the view's rows run against y.
    thetas = tuple(-math.atan2(y, x) for x, y in config.normals)
    bank = gabor_bank(params, thetas, normalise=config.normalise)
    responses = (cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE) for kernel in bank)
    return np.array([cv2.norm(r, cv2.NORM_L1, counted.view(np.uint8)) for r in responses]), pixels


def compute_word(view: ClothView, config: WordConfig) -> Word:
    """Algorithm 1 on a table view."""
    sums, pixels = wrinkle_sums(view, config)
    strength = float(sums.max()) / pixels if pixels else 0.0
    if strength <= config.noise_floor:
        none = np.zeros(2)
        return Word(direction=none, axial=none, coherence=0.0, strength=0.0, weights=np.zeros(config.orientations))
    weights = sums / sums.max()  # Eq. 3-2
    axial, coherence = axial_mean(weights, config.normals)
    return Word(
        direction=_unit(weights @ config.normals),  # Eq. 3-3
        axial=axial,
        coherence=coherence,
        strength=strength,
        weights=weights,
    )


class WordDescriptor:
    """WORD as a Descriptor: two numbers."""

    name = "word"
    size = 2

    def __init__(self, config: WordConfig | None = None) -> None:
        self.config = WordConfig() if config is None else config

    def describe(self, view: ClothView) -> NDArray[np.float64]:
        """(2,) unit vector with x >= 0, or zeros where there is no direction."""
        return compute_word(view, self.config).direction

    def direction(self, view: ClothView) -> Direction:
        """Eq. 3-3."""
        word = compute_word(view, self.config)
        return Direction(vector=word.direction, coherence=word.coherence, strength=word.strength)


def _reduced(view: ClothView, decimation: int) -> tuple[NDArray[np.float32], BoolArray, BoolArray, NDArray[np.float32]]:
    """Relative brightness, cloth, contact and height, each averaged over ``decimation`` squared pixels."""
    image, cloth, contact, height = relative_brightness(view.rgb, view.cloth), view.cloth, view.contact, view.height
    if decimation == 1:
        return image, cloth, contact, height
    size = (-(-cloth.shape[1] // decimation), -(-cloth.shape[0] // decimation))

    def average(array: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(array, size, interpolation=cv2.INTER_AREA), dtype=np.float32)

    masks = [average(mask.astype(np.float32)) > 0.5 for mask in (cloth, contact)]
    return average(image), masks[0], masks[1], average(height)


def relative_brightness(rgb: NDArray[np.uint8], cloth: BoolArray) -> NDArray[np.float32]:
    """(h, w): each pixel's share along the cloth's mean colour; 1 on average over the cloth.

    For a cloth of one colour this is the grey image with the least noise, whatever the colour.
    """
    colour = np.array(cv2.mean(rgb, cloth.view(np.uint8))[:3])
    power = float(colour @ colour)
    if power == 0.0:
        return np.ones(cloth.shape, dtype=np.float32)
    return np.asarray(cv2.transform(rgb.astype(np.float32), (colour / power)[None, :]), dtype=np.float32)


def _filled(image: NDArray[np.float32], inside: BoolArray, reach_px: float) -> NDArray[np.float32]:
    """The image inside; outside, the mean of what is inside within about ``reach_px``, or 1 beyond."""
    box = (2 * round(reach_px / 2) + 1,) * 2
    share = cv2.boxFilter(inside.astype(np.float32), -1, box, borderType=cv2.BORDER_CONSTANT)
    mean = cv2.boxFilter(np.where(inside, image - 1, np.float32(0)), -1, box, borderType=cv2.BORDER_CONSTANT)
    outside = 1 + mean / np.maximum(share, np.float32(1e-3))
    return np.where(inside, image, outside).astype(np.float32)


def _eroded(mask: BoolArray, radius_px: float) -> BoolArray:
    """Without the pixels nearer than ``radius_px`` to the outside or to the view's border."""
    return cv2.erode(mask.view(np.uint8), _disc(radius_px), borderType=cv2.BORDER_CONSTANT, borderValue=0).view(
        np.bool_
    )


def _dilated(mask: BoolArray, radius_px: float) -> BoolArray:
    """With the pixels nearer than ``radius_px`` to it."""
    return cv2.dilate(mask.view(np.uint8), _disc(radius_px)).view(np.bool_)


def _disc(radius_px: float) -> NDArray[np.uint8]:
    side = 2 * round(radius_px) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), dtype=np.uint8)


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    norm = float(np.linalg.norm(vector))
    return vector / norm if norm > 0 else np.zeros_like(vector)
