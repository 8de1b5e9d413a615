"""WORD, the wrinkle contraction direction: Algorithm 1, Eq. 3-2 and Eq. 3-3 of the thesis, in table coordinates.

Two descriptors share one computation. ``word`` is Algorithm 1 to the letter. ``word-axial`` averages the orientations
as the axes that they are, and looks at the relief as well as at the brightness, so that no light hides a wrinkle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.rectified_view import BoolArray, ClothView, bounding_window
from layflat.perception.descriptors.base import WrinkleDirection, axial_mean, wrinkle_normals
from layflat.perception.descriptors.gabor import GaborParams, responses
from layflat.perception.descriptors.preprocess import dilated, eroded, fill_holes, local_contrast, relative_brightness
from layflat.perception.errors import PerceptionError

THESIS_WAVELENGTH_PX = 8.0
"""lambda of figure 3-1, in pixels of its camera; the other lengths of Eq. 3-1 are taken as shares of it."""


@dataclass(frozen=True, kw_only=True)
class WordConfig:
    """How wrinkles are looked for; the defaults are Algorithm 1 with the parameters of figure 3-1.

    Lengths of the kernel are shares of its wavelength, and that is a length on the cloth: so they mean the same to
    every camera at every resolution.
    """

    orientations: int = 8
    """n of Algorithm 1."""
    wavelength_mm: float = 60.0
    """lambda. The shortest wrinkle of a 0.35 m cloth of 13x13 nodes is two cells, 58 mm."""
    sigma: float = 4.0 / THESIS_WAVELENGTH_PX
    """Standard deviation of the envelope across the stripes / wavelength."""
    gamma: float = 0.1
    """Aspect ratio: the envelope is sigma / gamma long along the stripes."""
    psi: float = 10.0
    """Phase of Eq. 3-1's sine, rad."""
    window: float = 12.0 / THESIS_WAVELENGTH_PX
    """Side of the kernel / wavelength."""
    zero_mean: bool = True
    """Take out of the kernel what answers to a cloth without wrinkles, where "all pixels have zero value"
    (section 3-1-2), which Eq. 3-1 with these parameters does not give. Every orientation then has the same gain."""
    half_wave: bool = True
    """Count positive responses only, as an image's pixels are; False counts their size."""
    rms: bool = False
    """Root mean square of the responses instead of their sum: a wrinkle on a tenth of the cloth then stands out of the
    noise on the rest. Goes with ``fill``."""
    fill: bool = False
    """Put the cloth's local mean outside its silhouette, so that its outline is not a wrinkle."""
    max_contrast: float = math.inf
    """Where finite, and with ``fill``: brightness relative to its local mean, and no more than so far from it."""
    relief: bool = False
    """Filter the height above the table, too, and add its responses as slopes."""
    erosion_mm: float = 0.0
    """Responses this close to the silhouette's edge do not count."""
    near_contact_mm: float = 0.0
    """Responses farther than this from the contact do not count (the flanks of a wrinkle are not in contact)."""
    max_height_m: float = math.inf
    """Nor do those where the cloth is higher than this."""
    noise_ratio: float = 2.2
    """Means up to this many times that of the weakest orientation are noise, which has no orientation, whatever the
    sensor, its distance and the exposure: 40 flat sheets under 0.25 to 1.5 of the exposure and 0.5 to 3 times a D435's
    noise showed at most 2.0 (and 1.7 with the kernel of ``word-axial``)."""
    min_response: float = 0.002
    """Nor do means below this count, relative brightness or slope: rounding to grey levels makes 0.0005."""
    min_area_mm2: float = 2500.0
    """There is no direction on less cloth than this: about a square of one wavelength."""

    def __post_init__(self) -> None:
        if self.orientations < 2:
            raise PerceptionError(f"orientations is {self.orientations}; at least 2 are needed")
        distances = (self.erosion_mm, self.near_contact_mm, self.min_response, self.min_area_mm2, self.max_contrast)
        if min(distances) < 0:
            raise PerceptionError(f"{self}: distances, areas and responses must not be negative")
        self.gabor(1.0)

    def gabor(self, mm_per_px: float) -> GaborParams:
        """Eq. 3-1's parameters in pixels of ``mm_per_px``."""
        wavelength = self.wavelength_mm / mm_per_px
        return GaborParams(
            wavelength=wavelength,
            sigma=self.sigma * wavelength,
            gamma=self.gamma,
            psi=self.psi,
            size=round(self.window * wavelength),
        )

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """(n, 2) v_i of Eq. 3-3, from ``wrinkle_normals``."""
        return wrinkle_normals(self.orientations)

    @cached_property
    def thetas(self) -> tuple[float, ...]:
        """The same as angles of the kernels' stripes: the view's rows run against y."""
        return tuple(-math.atan2(y, x) for x, y in self.normals)


THESIS_CONFIG = WordConfig()
"""Algorithm 1 to the letter."""

AXIAL_CONFIG = WordConfig(
    sigma=1 / 3,
    gamma=1.0,
    psi=math.pi / 2,
    window=4 / 3,
    half_wave=False,
    rms=True,
    fill=True,
    max_contrast=0.06,
    relief=True,
    erosion_mm=14.0,
    near_contact_mm=25.0,
    max_height_m=0.03,
    noise_ratio=1.8,
)
"""Chosen from the tables of docs/word.md. An even kernel is blind to a slow gradient of the light; a round envelope
answers to neighbouring orientations so evenly that eight of them interpolate without bias (a long one errs by 5 degrees
between them); the relief sees what the light does not; cut contrast keeps a shadow's edge from being a wrinkle."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Word:
    """Algorithm 1's result and what is known of its worth. Without wrinkles all numbers are 0."""

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
    """>= 0: mean response of the strongest orientation, as a share of the cloth's brightness plus, with relief, a
    slope. 0 where nothing exceeds the noise."""
    weights: NDArray[np.float64]
    """(n,) w of Eq. 3-2, 0..1, for wrinkles at i pi / n from the x axis."""


def compute_word(view: ClothView, config: WordConfig) -> Word:
    """Algorithm 1 on a table view."""
    sums, strength = orientation_responses(view, config)
    if strength == 0.0:
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


def orientation_responses(view: ClothView, config: WordConfig) -> tuple[NDArray[np.float64], float]:
    """L of Algorithm 1, (n,) per counted pixel, for each orientation; and the strength, 0 where there is no wrinkle."""
    view = _cropped(view, config)
    masks = response_masks(view, config)
    if masks is None:
        return np.zeros(config.orientations), 0.0
    light = brightness_image(view, config)
    sums, strength = _channel(light, masks, view.mm_per_px, config)
    if config.relief:
        relief, slope = _channel(height_image(view, config), masks, view.mm_per_px, config)
        sums, strength = sums + relief, strength + slope
    return sums, strength if sums.max() > 0 else 0.0


def _cropped(view: ClothView, config: WordConfig) -> ClothView:
    """The part of the view that the answers depend on: half a kernel around where they count."""
    reach_mm = max(config.window * config.wavelength_mm / 2 - config.erosion_mm, 0.0)
    window = bounding_window(view.cloth, margin=math.ceil(reach_mm / view.mm_per_px) + 2)
    if window is None:
        return view
    return ClothView(
        rgb=view.rgb[window],
        cloth=view.cloth[window],
        contact=view.contact[window],
        height=view.height[window],
        mm_per_px=view.mm_per_px,
    )


def _channel(
    image: NDArray[np.float32],
    masks: tuple[BoolArray, BoolArray],
    mm_per_px: float,
    config: WordConfig,
) -> tuple[NDArray[np.float64], float]:
    """(n,) mean response over the first mask, and the strength: the largest mean over the second, less the noise.

    Where the outside is filled, the noise's share is taken out of each mean: its power adds to that of the wrinkles.
    Algorithm 1 has no such thing; there the noise only tells whether there is a wrinkle.
    """
    window = bounding_window(masks[0])
    if window is None:
        return np.zeros(config.orientations), 0.0
    counted, inner = (mask[window].view(np.uint8) for mask in masks)
    pixels, inner_pixels = cv2.countNonZero(counted), cv2.countNonZero(inner)
    means, inners = [], []
    params = config.gabor(mm_per_px)
    for response in responses(image, params, config.thetas, normalise=config.zero_mean, window=window):
        if config.half_wave:
            response = np.maximum(response, 0, out=response)
        if config.rms:
            means.append(cv2.norm(response, cv2.NORM_L2, counted) / math.sqrt(pixels))
        else:
            means.append(cv2.norm(response, cv2.NORM_L1, counted) / pixels)
        inners.append(means[-1] if config.fill else cv2.norm(response, cv2.NORM_L1, inner) / inner_pixels)
    without_noise = subtract_noise(np.array(inners), config)
    strength = float(without_noise.max())
    if config.fill:
        return without_noise, strength
    return np.array(means) if strength > 0 else np.zeros(len(means)), strength


def subtract_noise(means: NDArray[np.float64], config: WordConfig) -> NDArray[np.float64]:
    """(n,) mean responses without what is noise among them, 0 where that is all."""
    floor = max(config.min_response, config.noise_ratio * float(means.min()))
    return np.sqrt(np.maximum(means**2 - floor**2, 0.0))


def response_masks(view: ClothView, config: WordConfig) -> tuple[BoolArray, BoolArray] | None:
    """Where responses count, and where of that the outline has no part in them; None where that is too little."""
    scale = 1 / view.mm_per_px
    counted = eroded(view.cloth, config.erosion_mm * scale) & dilated(view.contact, config.near_contact_mm * scale)
    counted &= view.height <= config.max_height_m
    inner = counted if config.fill else counted & eroded(view.cloth, config.window * config.wavelength_mm / 2 * scale)
    least = max(1.0, config.min_area_mm2 * scale**2)
    return (counted, inner) if cv2.countNonZero(inner.view(np.uint8)) >= least else None


def brightness_image(view: ClothView, config: WordConfig) -> NDArray[np.float32]:
    """(h, w) brightness relative to the cloth's mean, so that the exposure cancels."""
    image = relative_brightness(view.rgb, view.cloth)
    if not config.fill:
        return image
    inside, reach_px = eroded(view.cloth, 1.0), config.wavelength_mm / view.mm_per_px
    if config.max_contrast < math.inf:
        return local_contrast(image, inside, reach_px, config.max_contrast)
    return fill_holes(image, inside, reach_px, beyond=1.0)


def height_image(view: ClothView, config: WordConfig) -> NDArray[np.float32]:
    """(h, w) height in units in which a wave of slope s and of the kernel's wavelength has amplitude s."""
    per_m = 2 * math.pi / (config.wavelength_mm / 1000)
    height = np.minimum(view.height, np.float32(config.max_height_m)) * np.float32(per_m)
    return fill_holes(height, eroded(view.cloth, 1.0), config.wavelength_mm / view.mm_per_px, beyond=0.0)


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    norm = float(np.linalg.norm(vector))
    return vector / norm if norm > 0 else np.zeros_like(vector)


@dataclass(frozen=True, kw_only=True)
class WordDescriptor:
    """WORD as a descriptor, two numbers: ``word`` by default, ``word-axial`` from ``word_axial``."""

    name: str = "word"
    size: int = 2
    config: WordConfig = THESIS_CONFIG
    axial: bool = False
    """The doubled-angle mean instead of Eq. 3-3."""

    def describe(self, view: ClothView) -> NDArray[np.float64]:
        """(2,) the direction."""
        return self.direction(view).vector

    def direction(self, view: ClothView) -> WrinkleDirection:
        """WORD with its worth."""
        word = compute_word(view, self.config)
        vector = word.axial if self.axial else word.direction
        return WrinkleDirection(vector=vector, coherence=word.coherence, strength=word.strength)


def word_axial() -> WordDescriptor:
    """``word-axial`` with its settings."""
    return WordDescriptor(name="word-axial", config=AXIAL_CONFIG, axial=True)
