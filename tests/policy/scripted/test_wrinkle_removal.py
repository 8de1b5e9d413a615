"""Algorithm 2: which picker moves, where to, and when it ends."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.policy.scripted.wrinkle_removal import (
    CONTROLLERS,
    FLAT_CONTACT,
    FLAT_STEPS,
    STEP_M,
    WordFlatten,
    controller,
)
from layflat.policy.stopping import X_LIMIT_M
from layflat.tests.factories import PICKERS
from layflat.tests.policy.factories import observe

ANGLES = np.radians([-90, -60, -10, 10, 45, 90])


def moves_for(word, contact: float = 0.74) -> np.ndarray:
    return WordFlatten(PICKERS).act(observe(0.3, 0.0, contact=contact, word=word)).action.reshape(2, 3)


@pytest.mark.parametrize("angle", ANGLES)
def test_the_picker_on_words_side_moves_along_word_and_the_other_stays(angle):
    word = np.array([np.cos(angle), np.sin(angle)])
    moving, still = (0, 1) if word[1] > 0 else (1, 0)
    np.testing.assert_allclose(moves_for(word)[moving], [*(STEP_M * word), 0.0])
    assert not moves_for(word)[still].any()


def test_word_straight_to_the_front_moves_picker_2():
    """Algorithm 2 says W_y > 0, else: the line between belongs to picker 2."""
    np.testing.assert_allclose(moves_for((1.0, 0.0)), [[0.0, 0.0, 0.0], [STEP_M, 0.0, 0.0]])


def test_mirrored_wrinkles_give_mirrored_moves():
    """In a mirror along x, picker 1 is picker 2 and y is -y."""
    for angle in ANGLES[3:]:
        left, right = (moves_for((np.cos(a), np.sin(a))) for a in (angle, -angle))
        np.testing.assert_allclose(left[::-1] * [1, -1, 1], right, atol=1e-12)


def test_without_a_direction_both_pickers_move_to_the_front():
    np.testing.assert_allclose(moves_for((0.0, 0.0), contact=0.9), [[STEP_M, 0.0, 0.0]] * 2)


@pytest.mark.parametrize("word", [(0.8, 0.6), (0.0, 0.0)])
def test_it_ends_when_contact_stays_full_and_not_before(word):
    policy = WordFlatten(PICKERS)
    policy.reset(0)
    almost, full = (observe(0.3, contact=contact, word=word) for contact in (FLAT_CONTACT - 0.001, 1.0))
    seen = [*(FLAT_STEPS - 1) * [full], almost, *FLAT_STEPS * [full]]
    decisions = [policy.act(observation) for observation in seen]
    assert [d.stop for d in decisions] == [*(len(seen) - 1) * [None], "converged"]
    assert all(d.action.any() for d in decisions[:-1])


def test_the_end_of_the_view_is_a_limit_and_not_a_success():
    assert WordFlatten(PICKERS).act(observe(X_LIMIT_M, contact=0.8, word=(1.0, 0.0))).stop == "step_limit"


def test_the_comparators_move_by_the_same_step_in_the_plane():
    """Stretch-right exactly, random at most along each axis."""
    stretch, random = controller("stretch-right", PICKERS), controller("random", PICKERS)
    random.reset(3)
    moves = np.array([random.act(observe(0.3, contact=0.74)).action.reshape(2, 3) for _ in range(200)])
    assert not moves[..., 2].any()
    assert 0.9 * STEP_M < np.abs(moves).max() <= STEP_M
    assert (np.abs(moves).max(axis=0)[:, :2] > 0.9 * STEP_M).all()
    for word in ((0.6, 0.8), (0.0, 0.0)):
        straight = stretch.act(observe(0.3, contact=0.74, word=word)).action.reshape(2, 3)
        np.testing.assert_allclose(straight, [[STEP_M, 0.0, 0.0]] * 2)


def test_controllers_have_the_names_of_their_table():
    assert [controller(name, PICKERS).name for name in CONTROLLERS] == list(CONTROLLERS)
