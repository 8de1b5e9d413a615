"""Speed of the perception beside a reference implementation of the same numbers, and of HOW as it is published.

Frames are drawn, so that no simulation is needed; each function runs once in a fresh process, on one core.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.benchmarks.measure import alternating
from layflat.data.arrays import FloatArray
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.cloth.contact import contact_mask, smooth_height
from layflat.perception.cloth.pipeline import PerceptionConfig, PerceptionPipeline
from layflat.perception.cloth.segmentation import segment
from layflat.perception.descriptors.base import filter_angles
from layflat.perception.descriptors.gabor import gabor_bank
from layflat.perception.descriptors.how import HowConfig, HowDescriptor
from layflat.perception.descriptors.preprocess import PreprocessConfig
from layflat.perception.descriptors.registry import make_descriptor
from layflat.perception.descriptors.word import (
    AXIAL_CONFIG,
    WordConfig,
    brightness_image,
    height_image,
    orientation_responses,
    response_masks,
    subtract_noise,
)
from layflat.perception.synthetic_sheet import RenderConfig, RgbdFrame, SyntheticSheet, Wave, render_sheet
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor

FRAMES = 40


def perception(frames: int = FRAMES) -> dict[str, FloatArray]:
    """Measure wall s of one frame of 320x240, in turns.

    ``percept``, ``reference``, ``reference how``, and with other descriptors ``how``, ``word``, ``hog``.
    """
    camera = default_pinhole()
    frame = wrinkled_frame()
    perceivers = {
        name: PerceptionPipeline(camera, PerceptionConfig(descriptor=make_descriptor(key)), flat_pixels=19600)
        for name, key in (("percept", "word-axial"), ("how", "how"), ("word", "word"), ("hog", "hog"))
    }
    works: dict[str, Callable[[], object]] = {
        name: partial(by.perceive, frame.rgb, frame.depth) for name, by in perceivers.items()
    }
    works["reference"] = partial(reference_percept, perceivers["percept"], frame, AXIAL_CONFIG)
    works["reference how"] = partial(reference_how, perceivers["percept"], frame)
    return alternating(works, frames)


def wrinkled_frame(seed: int = 0) -> RgbdFrame:
    """Return a frame of the simulation's camera over a towel with wrinkles, with sensor noise."""
    drawn = render_sheet(
        default_pinhole(), SyntheticSheet(waves=(Wave(normal=0.5),)), RenderConfig(rgb_noise=3.0, seed=seed)
    )
    return RgbdFrame(drawn.rgb, DepthSensor(DepthNoise(), seed=seed).measure(drawn.depth))


def reference_percept(
    perceiver: PerceptionPipeline, frame: RgbdFrame, config: WordConfig
) -> tuple[int, NDArray[np.float64]]:
    """Return contact pixels and L of Algorithm 1, (n,), step by step on the whole image.

    ``PerceptionPipeline.perceive`` computes the same numbers on a part of the image and by transforms.
    """
    view = reference_view(perceiver, frame)
    return int(np.count_nonzero(view.contact)), reference_sums(view, config)


def reference_how(perceiver: PerceptionPipeline, frame: RgbdFrame) -> NDArray[np.float64]:
    """Return HOW as it is published: every filter over the whole image at its full resolution."""
    return HowDescriptor(HowConfig(preprocess=PreprocessConfig(decimation=1))).describe(
        reference_view(perceiver, frame)
    )


def reference_view(perceiver: PerceptionPipeline, frame: RgbdFrame) -> ClothView:
    """Return the rectified view of the whole table."""
    settings, camera = perceiver.config, perceiver.camera
    cloth_seen = segment(frame.rgb, settings.color, settings.min_area_px)
    height_seen = smooth_height(camera.height_above_table(frame.depth), cloth_seen, settings.smoothing_px)
    cloth = perceiver.rectifier.rectify_mask(cloth_seen)
    height = perceiver.rectifier.rectify(height_seen)
    return ClothView(
        rgb=perceiver.rectifier.rectify(frame.rgb),
        cloth=cloth,
        contact=contact_mask(cloth, height, settings.contact_height_m),
        height=height,
        mm_per_px=settings.grid.mm_per_px,
    )


def reference_sums(view: ClothView, config: WordConfig) -> NDArray[np.float64]:
    """Return L of Algorithm 1, (n,), with one ``filter2D`` of the whole view for each orientation."""
    masks = response_masks(view, config)
    if masks is None:
        return np.zeros(config.orientations)
    sums = _reference_channel(brightness_image(view, config), masks[0], view, config)
    if config.relief:
        sums = sums + _reference_channel(height_image(view, config), masks[0], view, config)
    return sums


def _reference_channel(
    image: NDArray[np.float32], counted: NDArray[np.bool_], view: ClothView, config: WordConfig
) -> NDArray[np.float64]:
    means = []
    for kernel in gabor_bank(config.gabor(view.mm_per_px), filter_angles(config.orientations), config.zero_mean):
        response = cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
        size = np.maximum(response, 0) if config.half_wave else np.abs(response)
        seen = size[counted].astype(np.float64)
        means.append(float(np.sqrt(np.mean(seen**2)) if config.rms else seen.mean()))
    return subtract_noise(np.array(means), config) if config.fill else np.array(means)


def reference_error(config: WordConfig = AXIAL_CONFIG) -> float:
    """Return the largest relative difference of L between the pipeline and the reference, over frames."""
    perceiver = PerceptionPipeline(default_pinhole())
    worst = 0.0
    for seed in range(4):
        frame = wrinkled_frame(seed)
        view = perceiver.cloth_view(frame.rgb, frame.depth)
        assert view is not None
        fast, reference = orientation_responses(view, config)[0], reference_percept(perceiver, frame, config)[1]
        worst = max(worst, float(np.abs(fast - reference).max() / reference.max()))
    return worst
