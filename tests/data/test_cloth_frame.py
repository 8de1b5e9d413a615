"""ClothFrame: every cloth as large as the towel, by properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.data.cloth_frame import NOMINAL_M, REST_M, ClothFrame, home_x_m
from layflat.data.types import ACTION_LIMIT_M
from layflat.tests.factories import HANGER, PICKERS
from layflat.tests.policy.factories import observe

SIDES = st.floats(0.15, 0.60)
FRAMES = st.builds(ClothFrame, length_m=SIDES, width_m=SIDES)
PLACES = st.tuples(st.floats(-0.3, 0.8), st.floats(-0.3, 0.3), st.floats(0.004, 0.8))


@given(place=PLACES)
def test_the_towels_frame_is_the_world_to_the_bit(place):
    towel, seen = ClothFrame(length_m=NOMINAL_M, width_m=NOMINAL_M), observe(place[0], place[2], y=0.17)
    assert towel.is_world
    np.testing.assert_array_equal(towel.held(np.array(place)), place)
    np.testing.assert_array_equal(towel.observation(seen).corner_positions, seen.corner_positions)
    move = np.array([0.012, -0.0031])
    np.testing.assert_array_equal(towel.action_to_world(move, HANGER, seen), move)


@given(frame=FRAMES)
def test_lying_flat_and_hanging_are_the_same_for_every_cloth(frame):
    home, half = home_x_m(frame.length_m), frame.width_m / 2
    laid = frame.held(np.array([home + frame.length_m, half, REST_M]))
    np.testing.assert_allclose(laid, [NOMINAL_M, NOMINAL_M / 2, REST_M], atol=1e-12)
    hung = frame.held(np.array([home, -half, frame.length_m + 0.12]))
    np.testing.assert_allclose(hung, [0.0, -NOMINAL_M / 2, NOMINAL_M + 0.12], atol=1e-12)


@given(frame=FRAMES, place=PLACES)
def test_slopes_are_the_derivative_of_the_place(frame, place):
    at, step = np.array(place), 1e-6
    away = abs(at[2] - frame.length_m) > 2 * step
    if away:
        np.testing.assert_allclose((frame.held(at + step) - frame.held(at)) / step, frame.slopes(at), rtol=1e-6)


@pytest.mark.parametrize("robot", [HANGER, PICKERS])
@given(frame=FRAMES, place=PLACES)
def test_a_long_move_is_shortened_not_turned(robot, frame, place):
    seen = observe(place[0], place[2], y=frame.width_m / 2)
    action = robot.pack([ACTION_LIMIT_M, 0.0, -ACTION_LIMIT_M])
    world = frame.action_to_world(action, robot, seen)
    assert np.abs(world).max() <= ACTION_LIMIT_M * (1 + 1e-12)
    wanted = action / robot.pack(frame.slopes(robot.points(seen)))
    np.testing.assert_allclose(world * np.abs(wanted).max(), wanted * np.abs(world).max(), atol=1e-12)


@given(frame=FRAMES)
def test_the_free_edge_keeps_its_height_above_the_table(frame):
    assert frame.on_table(np.array([0.1, 0.0, 0.03]))[2] == 0.03
