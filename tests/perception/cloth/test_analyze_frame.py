"""A frame without a known camera gives what the same frame gives with the camera's true place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from layflat.perception.camera.table_plane import TablePlane
from layflat.perception.cloth.analyze_frame import FrameResult, analyze_frame
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.errors import PerceptionError
from layflat.tests.perception.factories import axis_error
from layflat.tests.scenes import CLOTHS, TABLES, Scene, Shot, shoot, stand

BLUE = HsvRange()


def see(shot: Shot, **options) -> FrameResult:
    return analyze_frame(shot.rgb, shot.depth, shot.lens, rng=np.random.default_rng(0), **options)


def shot_of(scene: Scene, seed=0, missing=0.02, **place) -> Shot:
    camera, lens = stand(**({"width": 320, "height": 240} | place))
    return shoot(scene, camera, lens, seed=seed, missing=missing)


@pytest.mark.parametrize(
    ("place", "scene"),
    [
        ({"tilt": 0.0, "roll": 0.0}, Scene()),
        ({"tilt": 30.0, "roll": 15.0, "width": 640, "height": 480}, Scene(cloth=CLOTHS["red"], normal=-60.0)),
        ({"tilt": 45.0, "roll": -10.0, "width": 848, "height": 480}, Scene(cloth=CLOTHS["green"], lift_from=0.05)),
        ({"tilt": 20.0, "width": 1280, "height": 720}, Scene(cloth=CLOTHS["orange"], normal=80.0)),
    ],
    ids=["320x240", "640x480", "848x480", "1280x720"],
)
def test_as_with_the_true_pose(place, scene):
    shot = shot_of(scene, missing=0.1, **place)
    seen = see(shot)
    up = shot.camera.cam_to_world[2, :3]
    truth = TablePlane(normal=up, distance_m=float(shot.camera.position[2]), rms_m=0.0, inlier_share=1.0, n_inliers=9)
    expected = PerceptionPipeline(truth.camera(shot.lens), seen.config).see(shot.rgb, shot.depth, seen.cloth_mask)[0]
    flat = scene.side**2 / 0.0025**2
    assert seen.cloth_state.contact_pixels / flat == pytest.approx(expected.contact_pixels / flat, abs=0.02)
    assert axis_error(seen.cloth_state.word, expected.word) < 2.0
    assert seen.cloth_state.cloth_pixels == pytest.approx(expected.cloth_pixels, rel=0.01)
    assert seen.color_source == "suggested"


@pytest.mark.parametrize("roll", [0.0, 90.0, 180.0])
def test_directions_turn_with_the_image(roll):
    # Seen from straight above, a camera rolled by 90 degrees turns the picture, and so the answer, by as much.
    shot = shot_of(Scene(normal=35.0, amplitude=0.003), tilt=0.0, roll=roll)
    axis = math.radians(35.0 + roll)
    seen = see(shot)
    assert axis_error(seen.cloth_state.word, axis) < 4.0
    assert seen.cloth_state.word[0] >= 0


def test_flat_cloth_has_the_area_it_has_at_every_size_and_distance():
    for width, height, distance in ((320, 240, 0.7), (640, 480, 1.0), (424, 240, 0.8)):
        shot = shot_of(Scene(amplitude=0.0), width=width, height=height, distance=distance)
        assert see(shot).cloth_state.cloth_pixels == pytest.approx((0.35 / 0.0025) ** 2, rel=0.03)


def test_the_descriptors_view_shows_the_same_cloth():
    seen = see(shot_of(Scene(lift_from=0.0)))
    assert np.count_nonzero(seen.view.cloth) == seen.cloth_state.cloth_pixels
    assert np.count_nonzero(seen.view.contact) == seen.cloth_state.contact_pixels
    assert (seen.view.height[seen.view.contact] < 0.0081).all()


def test_other_things_of_the_cloths_colour_are_left_out():
    alone, beside = (shot_of(Scene(box=box), distance=0.9) for box in (None, CLOTHS["blue"]))
    at = (160, 120)
    one, two = see(alone, color=BLUE), see(beside, color=BLUE)
    assert two.cloth_state.cloth_pixels == pytest.approx(one.cloth_state.cloth_pixels, rel=0.01)
    assert "other things" not in " ".join(one.warnings)
    assert "other things" in two.warnings[0]
    assert see(beside, cloth_at=at).cloth_state.cloth_pixels == pytest.approx(one.cloth_state.cloth_pixels, rel=0.01)


def test_a_bar_across_the_cloth_does_not_halve_it():
    shot = shot_of(Scene(amplitude=0.0))
    rgb = shot.rgb.copy()
    rgb[:, 155:161] = TABLES["grey"]
    whole, barred = see(shot, color=BLUE), see(replace(shot, rgb=rgb), color=BLUE)
    assert barred.cloth_state.cloth_pixels > 0.9 * whole.cloth_state.cloth_pixels


def test_a_lifted_part_may_leave_the_picture_and_it_is_said():
    shot = shot_of(Scene(side=0.4, lift_from=0.05, centre=(0.25, 0.0), yaw=0.0, amplitude=0.0), tilt=20.0)
    assert shot.cloth[:, -1].any()
    assert "leaves the picture" in " ".join(see(shot).warnings)


def test_holes_and_noise_are_said():
    shot = shot_of(Scene(), missing=0.4)
    assert "has no depth" in " ".join(see(shot).warnings)
    camera, lens = stand(width=320, height=240)
    noisy = shoot(Scene(), camera, lens, seed=0, depth_noise=0.012)
    assert "scatters by" in " ".join(see(noisy).warnings)


def test_a_cloth_in_the_air_has_no_contact_and_no_direction():
    seen = see(shot_of(Scene(rest=0.1)), color=BLUE, flat_pixels=19600)
    assert "may be no cloth" in " ".join(seen.warnings)
    assert seen.cloth_state.contact_portion == 0.0
    assert not seen.cloth_state.word.any()
    assert seen.cloth_state.strength == 0.0


SHOT = shot_of(Scene())


@pytest.mark.parametrize(
    ("shot", "options", "message"),
    [
        (SHOT, {"color": HsvRange(hue_min=0, hue_max=20)}, "no cloth: no piece of the image has a hue of 0 to 20"),
        (shot_of(Scene(centre=(0.4, 0.0))), {}, "cut by the image's border"),
        (replace(SHOT, depth=0 * SHOT.depth), {}, "no value at all"),
        (replace(SHOT, depth=SHOT.depth * np.float32(25)), {}, "depth's unit"),
        (replace(SHOT, depth=SHOT.depth * np.float32(0.001)), {}, "depth's unit"),
        (replace(SHOT, depth=SHOT.depth[:-1]), {}, "this camera gives"),
        (replace(SHOT, depth=np.where(SHOT.cloth, np.float32(0), SHOT.depth)), {}, "has a depth, at least 20 %"),
        (replace(SHOT, depth=SHOT.depth + np.float32(0.1) * SHOT.cloth), {"color": BLUE}, "mm below the table"),
    ],
)
def test_what_cannot_be_seen_is_refused(shot, options, message):
    with pytest.raises(PerceptionError, match=message):
        see(shot, **options)
