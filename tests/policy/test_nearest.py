from __future__ import annotations

import numpy as np
import pytest
from sklearn.neighbors import KNeighborsRegressor

from layflat.policy import registry
from layflat.policy.features import input_set
from layflat.policy.nearest import MIN_STD_M
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import episode_of, observe

LAYOUT = input_set(HANGER, "all")


@pytest.fixture
def episodes():
    rng = np.random.default_rng(0)

    def episode(seed: int):
        seen = [observe(*rng.uniform(0, 0.4, 2), contact=c) for c in rng.uniform(0, 1, 25)]
        return episode_of(seen, rng.normal(0, 0.005, (25, 2)), seed=seed)

    return [episode(seed) for seed in range(3)]


def test_is_scikit_learns_nearest_neighbour(episodes):
    model = registry.train("nearest", episodes)
    inputs = np.concatenate([LAYOUT.matrix(e.steps) for e in episodes]) / LAYOUT.scales()
    actions = np.array([step.action for e in episodes for step in e.steps])
    queries = np.random.default_rng(1).uniform(-0.2, 0.6, (50, 5))
    mean, std = model.predict(queries)
    oracle = KNeighborsRegressor(1).fit(inputs, actions)
    np.testing.assert_array_equal(mean, oracle.predict(queries / LAYOUT.scales()))
    assert (std >= MIN_STD_M).all()


def test_a_demonstrated_step_gives_its_own_action(episodes):
    model = registry.train("nearest", episodes)
    for step in episodes[1].steps:
        np.testing.assert_array_equal(model.predict([LAYOUT.vector(step.observation)])[0][0], step.action)


def test_held_out_error_is_that_of_the_others_steps(episodes):
    errors = []
    for k, episode in enumerate(episodes):
        rest = registry.train("nearest", [e for e in episodes if e is not episodes[k]])
        errors.append(np.array([s.action for s in episode.steps]) - rest.predict(LAYOUT.matrix(episode.steps))[0])
    model = registry.train("nearest", episodes)
    np.testing.assert_allclose(model.heldout_rmse_m, np.sqrt((np.concatenate(errors) ** 2).mean(axis=0)))
    assert registry.train("nearest", episodes[:1]).heldout_rmse_m is None
