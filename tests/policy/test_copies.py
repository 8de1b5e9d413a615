"""Copies of demonstrations count once, and are held out together; the model knows what it was taught."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.data import open_session
from layflat.data.session.edited_demo import trimmed
from layflat.policy import model_io, registry
from layflat.policy.base import PolicyError
from layflat.policy.training_set import Demonstrations, build_training_set
from layflat.tests.factories import make_episode, write_session

ONCE = [make_episode(seed=seed, n_steps=30, sim_config={"start": "hanging"}) for seed in range(3)]
TWICE = [*ONCE, *(replace(episode, wall_s=9.0) for episode in ONCE)]
TRIMMED = trimmed(ONCE[1], 4, 25)
METHODS = ("gp-baseline", "gmr", "dmp", "nearest")


@pytest.mark.parametrize("policy", METHODS)
def test_a_model_of_copies_is_that_of_the_originals(policy):
    once, twice = (registry.train(policy, episodes) for episodes in (ONCE, TWICE))
    assert {name: array.tobytes() for name, array in twice.arrays().items()} == {
        name: array.tobytes() for name, array in once.arrays().items()
    }
    assert twice.heldout_rmse_m == once.heldout_rmse_m
    assert (twice.demonstrations, twice.points_available) == (3, 90)


@pytest.mark.parametrize("policy", METHODS)
def test_one_demonstration_with_its_copies_has_no_held_out_error(policy):
    assert registry.train(policy, [ONCE[1], TRIMMED, replace(ONCE[1], outcome="partial")]).heldout_rmse_m is None


@pytest.mark.parametrize("policy", ["gp-baseline", "gmr", "nearest"])
def test_steps_of_a_trimmed_copy_count_once(policy):
    once, more = (registry.train(policy, episodes) for episodes in (ONCE, [*ONCE, TRIMMED]))
    assert more.points_available == once.points_available == 90
    assert all(np.array_equal(array, once.arrays()[name]) for name, array in more.arrays().items())
    assert more.heldout_rmse_m == once.heldout_rmse_m


def test_a_trimmed_copy_first_leaves_the_rest_of_its_original():
    training = build_training_set([TRIMMED, *ONCE], "all", policy="gp-word")
    assert len(training.inputs) == 90
    assert training.demonstrations.recordings == (0, 1, 0, 3)
    assert len(np.unique(training.groups)) == 3


def test_demonstrations_of_a_file_and_of_memory_are_the_same(tmp_path):
    path = write_session(tmp_path / "s.h5", [*TWICE, TRIMMED])
    with open_session(path) as session:
        read = Demonstrations.from_session(session, session.names)
    made = Demonstrations.from_episodes([*TWICE, TRIMMED])
    for found in (read, made):
        assert found.seeds == (0, 1, 2, 1)
        assert found.recordings == (0, 1, 2, 1)
        assert found.repeated.sum() == 21
        assert set(found.starts) == {"hanging"}
    np.testing.assert_array_equal(read.actions, made.actions)


def test_the_model_file_knows_the_starts_it_was_taught(tmp_path):
    model = registry.train("nearest", TWICE)
    assert model.taught == (("hanging", 0), ("hanging", 1), ("hanging", 2))
    model_io.save(model, tmp_path / "m.npz")
    assert model_io.load(tmp_path / "m.npz").taught == model.taught
    with pytest.raises((PolicyError, ValueError)):
        replace(model, taught=(("hanging", "x"),))
