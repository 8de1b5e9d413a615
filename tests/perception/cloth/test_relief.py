"""The judgement of a real frame: how wrinkled, in which direction, and whether that is sure."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.cloth.analyze_frame import analyze_frame
from layflat.perception.cloth.relief import MIN_STRENGTH, fill_small_holes, measure_relief
from layflat.perception.cloth.wrinkle_regions import wrinkle_regions
from layflat.perception.errors import PerceptionError
from layflat.tests.perception.factories import axis_error
from layflat.tests.perception.reliefs import NOISES, camera_above, random_relief, rectangle, shoot, waves, with_noise

LEVEL = camera_above(0.0, 0.9)
FRAMES = Path(os.environ.get("LAYFLAT_FRAMES", "none"))
needs_frames = pytest.mark.skipif(not FRAMES.is_dir(), reason="LAYFLAT_FRAMES names no folder of real frames")


def wrinkles(*normals, noise="stereo", seed=5, camera=LEVEL, **options):
    return with_noise(shoot(waves(*normals, **options), camera=camera), noise, seed).relief().wrinkles()


@pytest.mark.parametrize("normal", range(-80, 91, 34))
def test_the_axis_is_across_the_wrinkles(normal):
    found = wrinkles(normal, camera=camera_above())
    assert axis_error(found.direction, math.radians(normal)) < 3.0
    assert found.coherence > 0.8


@pytest.mark.parametrize("noise", NOISES)
def test_flat_cloth_has_no_direction_under_any_noise(noise):
    for seed in range(2):
        found = wrinkles(noise=noise, seed=seed)
        assert found.is_flat
        assert not found.direction.any()


def test_strength_grows_with_the_relief_and_is_its_slope():
    amplitudes = np.array([0.0, 0.001, 0.002, 0.003, 0.004])
    strengths = [wrinkles(20, amplitude=amplitude).strength for amplitude in amplitudes]
    assert np.all(np.diff(strengths) > 0)
    assert strengths[0] < MIN_STRENGTH
    np.testing.assert_allclose(strengths[2:], amplitudes[2:] * 2 * math.pi / 0.06 / math.sqrt(2), rtol=0.2)


def test_wrinkles_in_two_directions_are_strong_and_have_none():
    one, two = (wrinkles(*normals, amplitude=0.003) for normals in ((20,), (20, 110)))
    assert one.has_direction
    assert not two.direction.any()
    assert two.coherence < 0.1
    assert two.strength == pytest.approx(math.sqrt(2) * one.strength, rel=0.1)


def test_a_crumpled_cloth_is_stronger_than_any_flat_one():
    flat = [wrinkles(noise=noise).strength for noise in NOISES]
    for seed in range(4):
        relief = random_relief(np.random.default_rng(seed), 0.0, 0.3)
        crumpled = with_noise(shoot(relief, camera=LEVEL), NOISES[seed], seed).relief().wrinkles()
        assert not crumpled.is_flat
        assert crumpled.strength > 2 * max(flat)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_turning_the_picture_turns_the_axis(turns):
    shot = with_noise(shoot(waves(25), camera=LEVEL), "stereo", 2)
    plain = shot.relief().wrinkles()
    lens = {"width": 240, "height": 320, "cx": LEVEL.cy, "cy": LEVEL.cx} if turns % 2 else {}
    turned = replace(
        shot,
        camera=replace(LEVEL, **lens),
        depth=np.ascontiguousarray(np.rot90(shot.depth, turns)),
        cloth=np.ascontiguousarray(np.rot90(shot.cloth, turns)),
    )
    found = turned.relief().wrinkles()
    angle = math.atan2(plain.axis[1], plain.axis[0]) + turns * math.pi / 2
    assert axis_error(found.direction, angle) < 1.0
    assert found.strength == pytest.approx(plain.strength, rel=0.03)
    assert found.coherence == pytest.approx(plain.coherence, abs=0.03)


@pytest.mark.parametrize("degrees", [17.0, -40.0])
def test_resampling_by_a_rotation_makes_no_direction_and_keeps_one(degrees):
    matrix = cv2.getRotationMatrix2D((LEVEL.cx, LEVEL.cy), degrees, 1.0)
    for height, normal in ((waves(), None), (waves(25), 25)):
        shot = with_noise(shoot(height, camera=LEVEL), "white", 3)
        depth = cv2.warpAffine(shot.depth, matrix, shot.depth.shape[::-1], flags=cv2.INTER_NEAREST)
        cloth = cv2.warpAffine(shot.cloth.astype(np.uint8), matrix, shot.depth.shape[::-1]) > 0
        found = replace(shot, depth=depth, cloth=cloth).relief().wrinkles()
        assert found.has_direction == (normal is not None)
        if normal is not None:
            assert axis_error(found.direction, math.radians(normal + degrees)) < 3.0


def test_holes_of_markers_do_not_matter():
    shot = with_noise(shoot(waves(25, amplitude=0.003), camera=LEVEL), "stereo", 4)
    rows, columns = np.indices(shot.cloth.shape)
    holes = (rows % 32 < 8) & (columns % 32 < 8)
    pierced = replace(shot, cloth=shot.cloth & ~holes)
    assert np.count_nonzero(shot.cloth & holes) > 0.05 * np.count_nonzero(shot.cloth)
    whole, found = shot.relief().wrinkles(), pierced.relief().wrinkles()
    assert axis_error(found.direction, whole.direction) < 1.0
    assert found.strength == pytest.approx(whole.strength, rel=0.05)


def test_only_small_holes_are_filled():
    mask = np.zeros((40, 40), dtype=bool)
    mask[2:-2, 2:-2] = True
    mask[5:8, 5:8] = mask[15:30, 15:30] = False
    filled = fill_small_holes(mask, 9)
    assert filled[5:8, 5:8].all()
    assert not filled[15:30, 15:30].any()
    assert not filled[:2].any()


def test_a_flat_cloth_that_rises_has_no_direction():
    def rising(x, y):
        return 0.004 + 0.5 * np.clip(x - 0.02, 0, None) + 0 * y

    assert not with_noise(shoot(rising, camera=LEVEL), "stereo", 1).relief().wrinkles().direction.any()


def test_too_little_cloth_and_no_table_have_no_direction():
    small = shoot(waves(25, amplitude=0.003), rectangle(0.06, 0.06), camera=LEVEL)
    assert not small.relief().wrinkles().direction.any()
    whole = shoot(waves(25, amplitude=0.003), rectangle(0.35, 0.35), camera=LEVEL)
    bare = replace(whole, depth=np.where(whole.cloth, whole.depth, np.float32(0)))
    assert bare.relief().wrinkles().noise == pytest.approx(MIN_STRENGTH)
    with pytest.raises(PerceptionError, match="must be the same"):
        measure_relief(LEVEL, whole.depth[:-1], whole.cloth)


def test_regions_have_their_own_directions():
    """Two halves of a cloth, wrinkled across each other: none for the whole, one for each half."""
    left, right = waves(10), waves(100)

    def height(x, y):
        return np.where(x < 0, left(x, y), right(x, y))

    relief = with_noise(shoot(height, rectangle(0.44, 0.3, yaw=0.0), camera=LEVEL), "stereo", 1).relief()
    assert not relief.wrinkles().has_direction
    regions = wrinkle_regions(relief)
    assert 0.7 < sum(region.share for region in regions) <= 1.0
    assert [region.share for region in regions] == sorted((region.share for region in regions), reverse=True)
    assert np.max(np.sum([region.mask for region in regions], axis=0)) == 1
    for normal, side in ((10, -1), (100, 1)):
        found = [region for region in regions if side * region.place_m[0] > 0]
        assert found
        assert all(axis_error(region.wrinkles.direction, math.radians(normal)) < 6.0 for region in found)


@pytest.mark.parametrize("noise", NOISES)
def test_a_flat_cloth_has_no_regions(noise):
    assert wrinkle_regions(with_noise(shoot(waves(), camera=LEVEL), noise, 7).relief()) == []


POLO = {
    "bottom": (-38, [(310, 310), (370, 290), (440, 260), (495, 330), (400, 420), (355, 375)]),
    "upper middle": (-20, [(408, 55), (445, 62), (420, 190), (378, 190)]),
    "middle band": (-80, [(367, 225), (475, 222), (465, 262), (375, 262)]),
    "left": (-70, [(268, 285), (300, 200), (365, 230), (365, 290), (290, 315)]),
    "right chest": (50, [(440, 190), (480, 120), (560, 160), (600, 290), (525, 290)]),
}
"""Parts of a real shirt: the pull that a person saw before any measurement, degrees, and the outline, px."""


@needs_frames
def test_a_real_crumpled_shirt_has_the_directions_that_a_person_sees():
    read = [cv2.imread(str(FRAMES / f"clopema_polo_wrinkled_{name}.png"), -1) for name in ("rgb", "depth")]
    rgb, depth = np.ascontiguousarray(read[0][..., ::-1]), read[1].astype(np.float32) / 1000
    lens = Intrinsics(width=640, height=480, fx=525, fy=525, cx=319.5, cy=239.5)
    frame = analyze_frame(rgb, depth, lens, rng=np.random.default_rng(0))
    relief = measure_relief(frame.camera, depth, frame.cloth_mask)
    whole, regions = relief.wrinkles(), wrinkle_regions(relief)
    assert not whole.direction.any()
    assert whole.strength > 3 * whole.min_strength
    assert sum(region.share for region in regions) > 0.8
    to_grid = np.linalg.inv(frame.camera.table_to_pixel @ relief.grid.pixel_to_table)
    errors = []
    for angle, outline in POLO.values():
        part = np.zeros(relief.inner.shape, np.uint8)
        cv2.fillPoly(part, [np.rint(cv2.perspectiveTransform(np.float64([outline]), to_grid)).astype(np.int32)], 1)
        errors.append(axis_error(relief.wrinkles(part > 0).direction, math.radians(angle)))
    print(f"degrees from the eye: {', '.join(f'{error:.1f}' for error in errors)}")
    assert np.median(errors) < 8.0
    assert max(errors) < 14.0
