"""Values that make no sense are refused with one sentence that names them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.cloth.pipeline import PerceptionConfig, PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.descriptors.gabor import GaborParams
from layflat.perception.descriptors.hog import HogConfig
from layflat.perception.descriptors.how import HowConfig
from layflat.perception.descriptors.preprocess import PreprocessConfig
from layflat.perception.descriptors.registry import make_descriptor
from layflat.perception.descriptors.word import WordConfig
from layflat.perception.errors import PerceptionError
from layflat.perception.overlay import draw_cloth_state
from layflat.perception.synthetic_sheet import Light, Wave, render_sheet
from layflat.tests.perception.factories import TILTED, render, striped_view, wrinkled_sheet

PIPELINE = PerceptionPipeline(TILTED)
RGB, DEPTH = np.zeros((240, 320, 3), np.uint8), np.ones((240, 320), np.float32)
STATE = PIPELINE.perceive(RGB, DEPTH)


def look(position, target=(0.0, 0.0, 0.0), width=4, height=3, fx=5.0) -> PinholeCamera:
    return PinholeCamera.look_at(position, target, width=width, height=height, fx=fx)


def lens(**changes: float) -> Intrinsics:
    good = {"width": 640, "height": 480, "fx": 615.0, "fy": 615.0, "cx": 320.0, "cy": 240.0}
    Intrinsics(**good)
    return Intrinsics(**(good | changes))


CASES = [
    ("finite", lambda: lens(fx=math.nan)),
    ("finite", lambda: lens(cy=math.inf)),
    ("between", lambda: lens(fx=0.0)),
    ("between", lambda: lens(fx=-615.0)),
    ("between", lambda: lens(fx=10.0, fy=10.0)),
    ("alike", lambda: lens(fy=300.0)),
    ("within", lambda: lens(cx=-1.0)),
    ("within", lambda: lens(cy=481.0)),
    ("parallel", lambda: look((0, 0, 1))),
    ("above the table", lambda: look((0, -1, -0.1))),
    ("orthonormal", lambda: replace(TILTED, cam_to_world=np.diag([2.0, 1.0, 1.0, 1.0]))),
    ("depth has shape", lambda: TILTED.height_above_table(np.zeros((3, 3)))),
    ("empty", lambda: TableGrid(x_min=0.5, x_max=0.2)),
    ("millimetres", lambda: TableGrid(mm_per_px=0.0025)),
    ("rgb is float64", lambda: PIPELINE.perceive(RGB.astype(float), DEPTH)),
    ("rgb is uint8 of shape", lambda: PIPELINE.perceive(RGB[:100], DEPTH)),
    ("depth has shape", lambda: PIPELINE.perceive(RGB, DEPTH[:, :10])),
    ("metres", lambda: PIPELINE.perceive(render(wrinkled_sheet()).rgb, 1000 * render(wrinkled_sheet()).depth)),
    ("must be odd", lambda: PerceptionConfig(smoothing_px=4)),
    ("below near_height_m", lambda: PerceptionConfig(contact_height_m=0.05)),
    ("flat_pixels is 0", lambda: PIPELINE.with_flat_pixels(0)),
    ("word has shape", lambda: replace(STATE, word=np.zeros(3))),
    ("hue range", lambda: HsvRange(hue_max=400)),
    ("saturation_min", lambda: HsvRange(saturation_min=90)),
    ("rgb has shape", lambda: draw_cloth_state(RGB[:10], STATE, TILTED)),
    ("scale is 0", lambda: draw_cloth_state(RGB, STATE, TILTED, scale=0)),
    ("must be positive", lambda: GaborParams(wavelength=0, sigma=4, gamma=0.1, psi=0, size=13)),
    ("a window of 60 px does not hold two or more whole cells of 8 px", lambda: HogConfig(window_px=60)),
    ("a window of 8 px", lambda: HogConfig(window_px=8)),
    ("bins is 1", lambda: HogConfig(bins=1)),
    ("noise_floor -1.0", lambda: HogConfig(noise_floor=-1.0)),
    ("1 orientations", lambda: HowConfig(orientations=1)),
    ("0 wavelengths", lambda: HowConfig(wavelengths_mm=())),
    (r"a grid of \(0, 4\)", lambda: HowConfig(grid=(0, 4))),
    ("must be positive", lambda: HowConfig(wavelengths_mm=(0.0,))),
    ("noise_floor is -1.0", lambda: HowConfig(noise_floor=-1.0)),
    ("decimation is 0", lambda: PreprocessConfig(decimation=0)),
    ("must not be negative", lambda: PreprocessConfig(erosion_mm=-1.0)),
    ("orientations is 1", lambda: WordConfig(orientations=1)),
    ("must be positive", lambda: WordConfig(sigma=0)),
    ("same pixels", lambda: replace(striped_view(), cloth=np.ones((3, 3), bool), contact=np.ones((3, 3), bool))),
    (r"'sift' is unknown; it must be one of word", lambda: make_descriptor("sift")),
    ("steep", lambda: Wave(amplitude_m=0.02)),
    ("must be positive", lambda: Wave(wavelength_m=0.0)),
    ("elevation", lambda: Light(elevation_deg=0.0)),
    ("horizon", lambda: render_sheet(look((0, 0, 0.5), (1, 0, 0.5), 32, 24, 30), None)),
]


@pytest.mark.parametrize(("message", "wrong"), CASES, ids=[message for message, _ in CASES])
def test_what_makes_no_sense_is_refused(message, wrong):
    with pytest.raises(PerceptionError, match=message) as caught:
        wrong()
    assert "\n" not in str(caught.value)
