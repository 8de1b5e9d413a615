"""WORD, the wrinkle contraction direction: Algorithm 1, Eq. 3-2 and Eq. 3-3 of the thesis, in table coordinates.

``word`` is Algorithm 1 to the letter. ``word-axial`` averages the orientations as axes, and uses the relief beside the
brightness, so that no light hides a wrinkle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, Float64Array, bounding_window, dilate, erode
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.descriptors.base import WrinkleDirection, axial_mean, filter_angles, wrinkle_normals
from layflat.perception.descriptors.gabor import GaborParams, gabor_responses
from layflat.perception.descriptors.preprocess import fill_holes, local_contrast, relative_brightness
from layflat.perception.errors import PerceptionError

THESIS_WAVELENGTH_PX = 8.0
"""lambda of figure 3-1, in pixels of its camera; the other lengths of Eq. 3-1 are shares of it."""


@dataclass(frozen=True, kw_only=True)
class WordConfig:
    """Settings of WORD; the defaults are Algorithm 1 with the parameters of figure 3-1.

    Lengths of the kernel are shares of its wavelength, a length on the cloth, and so mean the same to every camera.
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
    """Remove the response to a cloth without wrinkles, where "all pixels have zero value" (section 3-1-2); Eq. 3-1 does
    not. Every orientation then has the same gain."""
    half_wave: bool = True
    """Count positive responses only, as an image's pixels are; False counts their magnitude."""
    rms: bool = False
    """Use the root mean square of the responses instead of their sum: a wrinkle on a tenth of the cloth then stands out
    of the noise on the rest. Use with ``fill``."""
    fill: bool = False
    """Fill the outside of the silhouette with the cloth's local mean, so that its outline is not a wrinkle."""
    max_contrast: float = math.inf
    """If finite, and with ``fill``: take the brightness relative to its local mean, at most this far from it."""
    relief: bool = False
    """Filter the height above the table, too, and add its responses as slopes."""
    erosion_mm: float = 0.0
    """Responses this close to the silhouette's edge do not count."""
    near_contact_mm: float = 0.0
    """Responses farther than this from the contact do not count (the flanks of a wrinkle are not in contact)."""
    max_height_m: float = math.inf
    """Responses of higher cloth do not count."""
    noise_ratio: float = 2.2
    """Means up to this many times that of the weakest orientation are noise, which has no orientation, for any sensor,
    distance and exposure: 40 flat sheets under 0.25 to 1.5 of the exposure and 0.5 to 3 times a D435's noise had at
    most 2.0 (and 1.7 with the kernel of ``word-axial``)."""
    min_response: float = 0.002
    """Smaller means are noise too, relative brightness or slope: rounding to grey levels makes 0.0005."""
    min_area_mm2: float = 2500.0
    """Smallest area of cloth that has a direction: about a square of one wavelength."""

    def __post_init__(self) -> None:
        if self.orientations < 2:
            raise PerceptionError(f"orientations is {self.orientations}; at least 2 are needed")
        bounds = (self.erosion_mm, self.near_contact_mm, self.min_response, self.min_area_mm2, self.max_contrast)
        if min(bounds) < 0:
            raise PerceptionError(f"{self}: distances, areas and responses must not be negative")
        self.gabor(1.0)

    def gabor(self, mm_per_px: float) -> GaborParams:
        """Return the parameters of Eq. 3-1 in pixels of ``mm_per_px``."""
        wavelength = self.wavelength_mm / mm_per_px
        lengths = {"wavelength": wavelength, "sigma": self.sigma * wavelength}
        return GaborParams(**lengths, gamma=self.gamma, psi=self.psi, size=round(self.window * wavelength))

    @cached_property
    def normals(self) -> Float64Array:
        """(n, 2) v_i of Eq. 3-3, from ``wrinkle_normals``."""
        return wrinkle_normals(self.orientations)


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
"""Chosen from the tables of docs/explanation/results/word.md. An even kernel is blind to a slow gradient of the
light; a round envelope responds to neighbouring orientations so evenly that eight of them interpolate without bias (a
long one errs by 5 degrees between them); the relief shows what the light does not; cut contrast keeps a shadow's edge
from being a wrinkle."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WordResult:
    """Result of Algorithm 1 and its quality. Without wrinkles all numbers are 0."""

    direction: Float64Array
    """(2,) W of Algorithm 1: unit vector in table coordinates (x, y), x >= 0. The plain sum of Eq. 3-3 leans to +x: v_i
    spans a half circle, so that any response that all orientations share adds up to a vector along +x."""
    axial: Float64Array
    """(2,) unit vector, x >= 0: mean axis of the same responses with doubled angles, free of that lean."""
    coherence: float
    """Length of the doubled-angle mean: 1 if all responses are in one orientation, 0 if they are equal."""
    strength: float
    """Mean response of the strongest orientation, >= 0: share of the cloth's brightness, plus a slope with relief. 0 if
    nothing exceeds the noise."""
    weights: Float64Array
    """(n,) w of Eq. 3-2, 0..1, for wrinkles at i pi / n from the x axis."""


def compute_word(view: ClothView, config: WordConfig) -> WordResult:
    """Run Algorithm 1 on a rectified view."""
    sums, strength = orientation_responses(view, config)
    if strength == 0.0:
        none = np.zeros(2)
        return WordResult(direction=none, axial=none, coherence=0.0, strength=0.0, weights=np.zeros(len(sums)))
    weights = sums / sums.max()  # Eq. 3-2
    axial, coherence = axial_mean(weights, config.normals)
    direction = weights @ config.normals  # Eq. 3-3
    norm = float(np.linalg.norm(direction))
    direction = direction / norm if norm > 0 else np.zeros(2)
    return WordResult(direction=direction, axial=axial, coherence=coherence, strength=strength, weights=weights)


def orientation_responses(view: ClothView, config: WordConfig) -> tuple[Float64Array, float]:
    """Return L of Algorithm 1, (n,) per counted pixel, and the strength, 0 if there is no wrinkle."""
    # Half a kernel around the counted pixels is all that the responses depend on.
    reach_mm = max(config.window * config.wavelength_mm / 2 - config.erosion_mm, 0.0)
    window = bounding_window(view.cloth, margin=math.ceil(reach_mm / view.mm_per_px) + 2)
    view = view if window is None else view.crop(window)
    masks = response_masks(view, config)
    if masks is None:
        return np.zeros(config.orientations), 0.0
    sums, strength = _channel_responses(brightness_image(view, config), masks, view.mm_per_px, config)
    if config.relief:
        relief, slope = _channel_responses(height_image(view, config), masks, view.mm_per_px, config)
        sums, strength = sums + relief, strength + slope
    return sums, strength if sums.max() > 0 else 0.0


def _channel_responses(
    image: Float32Array, masks: tuple[BoolArray, BoolArray], mm_per_px: float, config: WordConfig
) -> tuple[Float64Array, float]:
    """Return (n,) mean response over the first mask; and the strength, the largest mean over the second less noise.

    With a filled outside the noise's share is taken out of each mean: its power adds to that of the wrinkles.
    Algorithm 1 does not do that; there the noise only decides whether there is a wrinkle.
    """
    window = bounding_window(masks[0])
    if window is None:
        return np.zeros(config.orientations), 0.0
    counted, inner = (mask[window].view(np.uint8) for mask in masks)
    pixels, inner_pixels = cv2.countNonZero(counted), cv2.countNonZero(inner)
    means, inner_means = [], []
    params, angles = config.gabor(mm_per_px), filter_angles(config.orientations)
    for response in gabor_responses(image, params, angles, normalize=config.zero_mean, window=window):
        if config.half_wave:
            response = np.maximum(response, 0, out=response)
        if config.rms:
            means.append(cv2.norm(response, cv2.NORM_L2, counted) / math.sqrt(pixels))
        else:
            means.append(cv2.norm(response, cv2.NORM_L1, counted) / pixels)
        inner_means.append(means[-1] if config.fill else cv2.norm(response, cv2.NORM_L1, inner) / inner_pixels)
    denoised = subtract_noise(np.array(inner_means), config)
    strength = float(denoised.max())
    if config.fill:
        return denoised, strength
    return np.array(means) if strength > 0 else np.zeros(len(means)), strength


def subtract_noise(means: Float64Array, config: WordConfig) -> Float64Array:
    """Return (n,) mean responses without the noise in them, 0 where there is nothing else."""
    floor = max(config.min_response, config.noise_ratio * float(means.min()))
    return np.sqrt(np.maximum(means**2 - floor**2, 0.0))


def response_masks(view: ClothView, config: WordConfig) -> tuple[BoolArray, BoolArray] | None:
    """Return the pixels that count, and those of them that the outline does not influence; None if they are too few."""
    scale = 1 / view.mm_per_px
    counted = erode(view.cloth, config.erosion_mm * scale) & dilate(view.contact, config.near_contact_mm * scale)
    counted &= view.height <= config.max_height_m
    inner = counted if config.fill else counted & erode(view.cloth, config.window * config.wavelength_mm / 2 * scale)
    min_pixels = max(1.0, config.min_area_mm2 * scale**2)
    return (counted, inner) if cv2.countNonZero(inner.view(np.uint8)) >= min_pixels else None


def brightness_image(view: ClothView, config: WordConfig) -> Float32Array:
    """Return (h, w) brightness relative to the cloth's mean, so that the exposure cancels."""
    image = relative_brightness(view.rgb, view.cloth)
    if not config.fill:
        return image
    inside, reach_px = erode(view.cloth, 1.0), config.wavelength_mm / view.mm_per_px
    if config.max_contrast < math.inf:
        return local_contrast(image, inside, reach_px, config.max_contrast)
    return fill_holes(image, inside, reach_px, background=1.0)


def height_image(view: ClothView, config: WordConfig) -> Float32Array:
    """Return (h, w) height in units in which a wave of slope s and of the kernel's wavelength has amplitude s."""
    per_m = 2 * math.pi / (config.wavelength_mm / 1000)
    height = np.minimum(view.height, np.float32(config.max_height_m)) * np.float32(per_m)
    return fill_holes(height, erode(view.cloth, 1.0), config.wavelength_mm / view.mm_per_px, background=0.0)


@dataclass(frozen=True, kw_only=True)
class WordDescriptor:
    """WORD as a descriptor of two numbers: ``word`` by default, ``word-axial`` from ``word_axial``."""

    name: str = "word"
    size: int = 2
    config: WordConfig = THESIS_CONFIG
    axial: bool = False
    """Use the doubled-angle mean instead of Eq. 3-3."""

    def describe(self, view: ClothView) -> Float64Array:
        """Return the direction (2,)."""
        return self.direction(view).vector

    def direction(self, view: ClothView) -> WrinkleDirection:
        """Return WORD and its quality."""
        word = compute_word(view, self.config)
        vector = word.axial if self.axial else word.direction
        return WrinkleDirection(vector=vector, coherence=word.coherence, strength=word.strength)


def word_axial() -> WordDescriptor:
    """Return ``word-axial`` with its settings."""
    return WordDescriptor(name="word-axial", config=AXIAL_CONFIG, axial=True)
