"""Ranges of colour that are learned from a point or from the cloth's pixels find the cloth, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.perception.cloth.color_calibration import hue_name, learn_hsv, name_color, range_of_cloth
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.perception.errors import PerceptionError
from layflat.tests.scenes import CLOTHS, TABLES, Scene, Shot, shoot, stand

CAMERA, LENS = stand(width=320, height=240)


def scene_of(cloth: str, table: tuple[float, float, float] = TABLES["white"], seed: int = 0, **changes: object) -> Shot:
    return shoot(replace(Scene(cloth=CLOTHS[cloth], table=table), **changes), CAMERA, LENS, seed=seed)


def overlap(shot: Shot, color: HsvRange) -> float:
    """Intersection over union of what the range finds and the cloth."""
    found = segment(shot.rgb, color)
    return float((found & shot.cloth).sum() / (found | shot.cloth).sum())


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("cloth", CLOTHS)
def test_a_coloured_cloth_is_learned_and_suggested(cloth, table):
    shot = scene_of(cloth, TABLES[table], seed=len(cloth), amplitude=0.004)
    rows, columns = np.nonzero(shot.cloth)
    middle = (int(columns.mean()), int(rows.mean()))
    assert overlap(shot, learn_hsv(shot.rgb, middle)) > 0.95
    color = range_of_cloth(shot.rgb, shot.cloth)
    assert color is not None
    assert overlap(shot, color) > 0.95


def test_a_red_cloths_range_goes_through_0():
    shot = scene_of("red")
    for colour in (range_of_cloth(shot.rgb, shot.cloth), learn_hsv(shot.rgb, (160, 120))):
        assert colour.hue_min > 300 > 60 > colour.hue_max


def test_the_range_learned_in_the_light_holds_the_shade():
    # Steep wrinkles with little ambient light: some flanks have a third of the brightness of others.
    shot = scene_of("green", amplitude=0.008, ambient=0.15)
    value = shot.rgb.max(axis=2)
    rows, columns = np.nonzero(shot.cloth & (value > np.percentile(value[shot.cloth], 90)))
    assert np.percentile(value[shot.cloth], 2) < 0.4 * value[shot.cloth].max()
    assert overlap(shot, learn_hsv(shot.rgb, (int(columns[50]), int(rows[50])))) > 0.9


def test_grey_has_no_hue():
    shot = scene_of("blue")
    with pytest.raises(PerceptionError, match="is grey"):
        learn_hsv(shot.rgb, (5, 235))
    black = np.full((240, 320, 3), 12, np.uint8)
    with pytest.raises(PerceptionError, match="is black"):
        learn_hsv(black, (5, 5))


@pytest.mark.parametrize(
    ("rgb", "name"), [((235, 235, 235), "white"), ((110, 112, 108), "grey"), ((20, 20, 24), "black")]
)
def test_a_cloth_without_a_hue_has_a_name_and_no_range(rgb, name):
    shot = shoot(Scene(cloth=rgb, table=TABLES["grey"]), CAMERA, LENS, seed=0)
    assert range_of_cloth(shot.rgb, shot.cloth) is None
    assert name_color(shot.rgb, shot.cloth) == name


def test_two_halves_of_two_colours_are_many_coloured():
    rgb = np.full((240, 320, 3), 220, np.uint8)
    rgb[60:120, 100:200], rgb[120:180, 100:200] = CLOTHS["red"], CLOTHS["green"]
    cloth = np.zeros((240, 320), dtype=bool)
    cloth[60:180, 100:200] = True
    assert name_color(rgb, cloth) == "many-coloured"
    assert name_color(rgb, cloth & (np.arange(240)[:, None] < 120)) == "red"


@pytest.mark.parametrize("at", [(-1, 0), (0, -1), (320, 0), (0, 240)])
def test_a_point_outside_is_refused(at):
    with pytest.raises(PerceptionError, match="outside the image, which is 320x240"):
        learn_hsv(scene_of("blue").rgb, at)


def test_a_speck_is_no_cloth():
    rgb = np.full((240, 320, 3), 220, np.uint8)
    rgb[100:107, 100:107] = CLOTHS["blue"]
    with pytest.raises(PerceptionError, match="point at the middle"):
        learn_hsv(rgb, (103, 103))


def test_hues_have_names():
    named = {degrees: hue_name(degrees) for degrees in (0, 359, 30, 60, 120, 180, 225, 270, 300)}
    assert list(named.values()) == [
        "red", "red", "orange", "yellow", "green", "cyan", "blue", "violet", "magenta",
    ]  # fmt: skip
