"""A person's corrections can count more often than the other steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from layflat.policy import registry
from layflat.policy.features import input_set
from layflat.policy.gp.kernel import JITTER
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import episode_of, observe

LAYOUT = input_set(HANGER, "all")


@pytest.fixture(scope="module")
def disagreeing():
    """One drags on by 3 mm everywhere; the other, a corrected one, by 9 mm beyond x = 0.2. Both miss by 0.3 mm."""
    rng = np.random.default_rng(1)
    episodes = []
    for number in range(2):
        places = np.linspace(0.0, 0.4, 30)
        marked = (places > 0.2) if number else np.zeros(30, bool)
        actions = np.where(marked, 0.009, 0.003) + rng.normal(0, 0.0003, 30)
        seen = [observe(x, 0.0, contact=2 * x) for x in places]
        episode = episode_of(seen, np.column_stack([actions, rng.normal(0, 0.0003, 30)]), seed=number)
        steps = [replace(step, intervention=bool(m)) for step, m in zip(episode.steps, marked, strict=True)]
        episodes.append(replace(episode, steps=steps))
    return episodes


@pytest.fixture(scope="module")
def models(disagreeing):
    return {weight: registry.train("gp-word", disagreeing, intervention_weight=weight) for weight in (1, 4)}


def test_a_weight_is_a_noise_of_its_own_for_each_step(disagreeing, models):
    """scikit-learn's process, with the noise of corrected steps a quarter of the others', predicts the same."""
    model = models[4]
    steps = [step for episode in disagreeing for step in episode.steps]
    matrix, hyper = LAYOUT.matrix(steps), model.hyper
    share = np.where([step.intervention for step in steps], 4, 1)
    queries = np.vstack([matrix[::7], matrix[::7] + 0.05])
    mean, std = model.predict(queries)
    for a in range(2):
        kernel = ConstantKernel(hyper.variance[a]) * RBF(hyper.length_scales[a])
        other = GaussianProcessRegressor(kernel, alpha=(hyper.noise[a] + JITTER) / share, optimizer=None)
        other.fit(matrix / LAYOUT.scales(), np.array([step.action[a] for step in steps]) / model.output_scale_m)
        wanted, spread = other.predict(queries / LAYOUT.scales(), return_std=True)
        np.testing.assert_allclose(mean[:, a], model.output_scale_m * wanted, atol=1e-7)
        total = model.output_scale_m * np.sqrt(spread**2 + hyper.noise[a])
        np.testing.assert_allclose(std[:, a], total, atol=1e-7)


def test_where_two_disagree_the_corrected_one_wins_by_its_weight(models, disagreeing):
    there = LAYOUT.matrix([step for step in disagreeing[1].steps if step.observation.holder_position[0] > 0.28])
    moved = {weight: 1000 * model.predict(there)[0][:, 0].mean() for weight, model in models.items()}
    # Shares of 3 and 9 mm: half and half, or one fifth and four.
    assert moved[1] == pytest.approx(6.0, abs=0.5)
    assert moved[4] == pytest.approx(0.2 * 3 + 0.8 * 9, abs=0.5)


def test_the_likelihood_counts_each_step_once(models):
    for name in ("length_scales", "variance", "noise"):
        np.testing.assert_array_equal(getattr(models[1].hyper, name), getattr(models[4].hyper, name))
    assert models[1].heldout_rmse_m == models[4].heldout_rmse_m
    assert models[4].points_available == models[1].points_available == 60


def test_without_corrections_a_weight_changes_nothing(disagreeing):
    plain = [replace(e, steps=[replace(step, intervention=False) for step in e.steps]) for e in disagreeing]
    five, one = (registry.train("gp-word", plain, intervention_weight=weight) for weight in (5, 1))
    np.testing.assert_array_equal(five.alpha, one.alpha)
