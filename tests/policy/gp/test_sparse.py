from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.policy import model_io
from layflat.policy.base import PolicyError
from layflat.policy.features import input_set
from layflat.policy.gp import fit, sparse
from layflat.policy.gp.kernel import Hyperparameters, weights
from layflat.policy.gp.model import GpModel
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import episode_of, fit_with, observe

NOISE_STD = 0.05


def problem(points: int = 120, seed: int = 0) -> tuple[np.ndarray, np.ndarray, Hyperparameters]:
    rng = np.random.default_rng(seed)
    inputs = rng.uniform(-2, 2, (points, 2))
    x, y = inputs.T
    ground_truth = np.column_stack([np.sin(x) * np.cos(y), x * np.exp(-(y**2))])
    lengths, noise = [[0.9, 0.9], [0.7, 0.7]], [NOISE_STD**2, 0.01]
    hyper = Hyperparameters(kernel="se", length_scales=lengths, variance=[1.0, 0.8], noise=noise)
    return inputs, ground_truth + rng.normal(0, NOISE_STD, ground_truth.shape), hyper


def made(points: np.ndarray, alpha: np.ndarray, hyper: Hyperparameters, inner: np.ndarray | None = None) -> GpModel:
    fields = {"policy": "gp-baseline", "layout": input_set(HANGER, "position"), "cloth": "towel"}
    fields |= {"input_scale": np.ones(2), "output_scale_m": 1.0}
    return GpModel(inputs=points, alpha=alpha, hyper=hyper, inner=inner, **fields)


def full_and_sparse(count: int, points: int = 120, shrink: float = 1.0) -> tuple[GpModel, GpModel]:
    inputs, targets, hyper = problem(points)
    hyper = replace(hyper, length_scales=shrink * hyper.length_scales)
    inducing = sparse.inducing_points(inputs, count, seed=0)
    alpha, inner = sparse.compress(inducing, inputs, targets, hyper)
    return made(inputs, weights(inputs, targets, hyper), hyper), made(inducing, alpha, hyper, inner)


QUERIES = np.random.default_rng(5).uniform(-1.9, 1.9, (40, 2))


def test_with_every_step_an_inducing_point_it_is_the_full_process():
    # Short length scales: the jitter of K_uu is the only difference, and counts for more the smoother the process.
    full, sparse = full_and_sparse(count=60, points=60, shrink=0.3)
    for ours, theirs in zip(sparse.predict(QUERIES), full.predict(QUERIES), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_more_inducing_points_come_closer_to_the_full_process():
    errors = []
    for count in (10, 40, 150):
        pair = [model.predict(QUERIES) for model in full_and_sparse(count, points=400)]
        errors.append([np.abs(a - b).max() for a, b in zip(*pair, strict=True)])
    assert (np.diff(errors, axis=0) < 0).all()
    assert max(errors[-1]) < 0.2 * NOISE_STD


def test_prediction_is_gpys_own():
    inputs, targets, hyper = problem()
    gpy, inducing = fit.import_gpy(), sparse.inducing_points(inputs, 25, seed=0)
    alpha, inner = sparse.compress(inducing, inputs, targets, hyper)
    model = made(inducing, alpha, hyper, inner)
    mean, std = model.predict(QUERIES)
    for a in range(2):
        kernel = gpy.kern.RBF(2, variance=hyper.variance[a], lengthscale=hyper.length_scales[a, 0])
        theirs = gpy.models.SparseGPRegression(inputs, targets[:, [a]], kernel, Z=inducing)
        theirs.likelihood.variance[:] = hyper.noise[a]
        want, variance = theirs.predict(QUERIES)
        np.testing.assert_allclose(mean[:, a], want[:, 0], atol=1e-6)
        np.testing.assert_allclose(std[:, a] ** 2, variance[:, 0], atol=1e-6)


def test_one_query_is_answered_as_many_are():
    for model in full_and_sparse(count=20):
        many = model.predict(QUERIES)
        for k, query in enumerate(QUERIES):
            for one, all_ in zip(model.predict([query]), many, strict=True):
                np.testing.assert_allclose(one[0], all_[k], atol=1e-10)


def test_far_away_the_deviation_is_the_priors():
    _, sparse = full_and_sparse(count=20)
    mean, std = sparse.predict([[500.0, 500.0]])
    np.testing.assert_allclose(mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(std[0], sparse.prior_std)


def test_held_out_errors_are_those_of_models_trained_without_the_group():
    inputs, targets, hyper = problem(90)
    inducing = sparse.inducing_points(inputs, 20, seed=0)
    groups = np.repeat([3, 1, 2], [40, 30, 20])
    errors = sparse.held_out_errors(inducing, inputs, targets, groups, hyper)
    for group in (1, 2, 3):
        out = groups == group
        alpha, inner = sparse.compress(inducing, inputs[~out], targets[~out], hyper)
        mean, _ = made(inducing, alpha, hyper, inner).predict(inputs[out])
        np.testing.assert_allclose(errors[out], targets[out] - mean, atol=1e-6)


@pytest.fixture(scope="module")
def long_demonstrations():
    """More than 2,000 steps: drags whose speed depends on x and on contact."""
    rng, episodes = np.random.default_rng(0), []
    for seed in range(3):
        xs, contacts = rng.uniform(0, 0.4, 700), rng.uniform(0.5, 1, 700)
        seen = [observe(x, 0.0, contact=c) for x, c in zip(xs, contacts, strict=True)]
        move = 0.012 * (1 - contacts) + 0.004 * np.sin(12 * xs) + rng.normal(0, 3e-4, 700)
        episodes.append(episode_of(seen, np.column_stack([move, np.zeros(700)]), seed=seed))
    return episodes


def test_beyond_two_thousand_steps_training_switches_by_itself(long_demonstrations, tmp_path):
    options = fit.FitOptions(inducing_points=40)
    model = fit_with(fit.fit, long_demonstrations, options=options)
    assert fit.MAX_POINTS == 2000 < model.points_available == 2100
    assert model.n_points == 40
    assert "sparse" in model.point_name
    assert model.heldout_rmse_m is not None
    assert model.heldout_rmse_m[0] < 4e-4  # the noise of the demonstrator is 3e-4
    model_io.save(model, tmp_path / "m.npz")
    again = model_io.load(tmp_path / "m.npz")
    assert isinstance(again, GpModel)
    for ours, theirs in zip(model.predict(model.inputs), again.predict(model.inputs), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    few = fit_with(fit.fit, long_demonstrations[:1])
    assert few.inner is None
    assert few.n_points == 700


def test_an_invalid_inner_factor_is_refused():
    _, sparse = full_and_sparse(count=20)
    for inner, message in ((np.zeros((2, 20, 20)), "lower factor"), (np.ones((2, 19, 20)), "inner has shape")):
        with pytest.raises(PolicyError, match=message):
            replace(sparse, inner=inner)


def test_inducing_points_on_top_of_each_other_are_refused():
    inputs, targets, hyper = problem(40)
    wide = replace(hyper, length_scales=np.full((2, 2), 1e6))
    huge = replace(wide, variance=np.full(2, 1e12))
    with pytest.raises(PolicyError, match="too close"):
        sparse.compress(inputs, inputs, targets, huge)
