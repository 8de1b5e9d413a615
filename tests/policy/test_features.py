from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.policy.features import INPUT_SETS, columns_of, input_set
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS
from layflat.tests.policy.factories import episode_of, observe


@pytest.mark.parametrize(
    ("robot", "inputs", "size"),
    [(HANGER, "position", 2), (HANGER, "all", 5), (PICKERS, "position", 6), (PICKERS, "all", 9)],
)
def test_sizes_are_those_of_the_thesis(robot, inputs, size):
    layout = input_set(robot, inputs)
    assert layout.size == size
    assert layout.vector(observe()).shape == layout.scales().shape == (size,)


def test_a_layout_is_the_position_word_and_contact():
    vector = input_set(HANGER, "all").vector(observe(0.1, 0.2, contact=0.7, word=(0.8, -0.6)))
    np.testing.assert_array_equal(vector, [0.1, 0.2, 0.8, -0.6, 0.7])
    corners = np.arange(6.0).reshape(2, 3) / 10
    seen = observe(contact=0.25, word=(0.6, 0.8))
    observation = replace(seen, corner_positions=corners, holder_position=corners.mean(axis=0))
    vector = input_set(PICKERS, "all").vector(observation)
    np.testing.assert_array_equal(vector, [*corners.ravel(), 0.6, 0.8, 0.25])


@pytest.mark.parametrize("robot", ROBOT_SPECS)
@given(contact=st.floats(0, 1), angle=st.floats(-1.5, 1.5))
def test_cloth_state_reaches_exactly_the_sets_that_name_it(robot, contact, angle):
    word = (np.cos(angle), np.sin(angle))
    calm, stirred = observe(0.1, 0.1, contact=0.5), observe(0.1, 0.1, contact=contact, word=word)
    for name in INPUT_SETS:
        layout = input_set(robot, name)
        moved = layout.vector(calm) != layout.vector(stirred)
        changed = {column for column, differs in zip(layout.names, moved, strict=True) if differs}
        expected = {"contact"} if contact != 0.5 else set()
        expected |= {"word_x"} if word[0] != 0 else set()
        expected |= {"word_y"} if word[1] != 0 else set()
        assert changed == expected & set(layout.names)


def test_matrix_is_the_vectors_in_order():
    observations = [observe(0.1 * k, 0.3, contact=0.2 * k) for k in range(4)]
    layout = input_set(HANGER, "all")
    matrix = layout.matrix(episode_of(observations, np.zeros((4, 2))).steps)
    np.testing.assert_array_equal(matrix, [layout.vector(o) for o in observations])
    assert layout.matrix([]).shape == (0, 5)


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_no_column_reads_what_only_the_simulator_knows(robot):
    assert not {"nodes", "contact_true", "flat_area"} & set(columns_of(robot))
