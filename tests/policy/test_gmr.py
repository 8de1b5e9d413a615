from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from layflat.policy import registry
from layflat.policy.features import input_set
from layflat.policy.gmr import REGULARISATION, GmrModel, fit, fit_mixture
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import demonstrations, episode_of, fit_with, observe

SCALE_M = 0.01


def model_with(weights, means, covariances, inputs: str = "all") -> GmrModel:
    layout = input_set(HANGER, inputs)
    fields = {"policy": "gmr", "layout": layout, "cloth": "towel", "input_scale": layout.scales()}
    return GmrModel(**fields, output_scale_m=SCALE_M, weights=weights, means=means, covariances=covariances)


def random_covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def assert_is_conditional(model: GmrModel, mean, covariance, x: np.ndarray, atol: float) -> None:
    """Compare with the textbook's formula, by inversion."""
    d, ((got,), (std,)) = len(x), model.predict([x * model.input_scale])
    gain = covariance[d:, :d] @ np.linalg.inv(covariance[:d, :d])
    np.testing.assert_allclose(got / SCALE_M, mean[d:] + gain @ (x - mean[:d]), atol=atol)
    variance = np.diag(covariance[d:, d:] - gain @ covariance[:d, d:])
    np.testing.assert_allclose((std / SCALE_M) ** 2, variance, atol=atol)


def test_one_component_is_the_gaussian_conditional():
    rng = np.random.default_rng(0)
    mean, covariance = rng.normal(size=7), random_covariance(rng, 7)
    model = model_with([1.0], [mean], [covariance])
    for _ in range(20):
        assert_is_conditional(model, mean, covariance, rng.normal(size=5) * 3, atol=1e-10)


def test_far_from_the_others_a_component_predicts_alone():
    rng = np.random.default_rng(1)
    means = rng.normal(size=(2, 7))
    means[1, :5] += 60.0
    covariances = [random_covariance(rng, 7) for _ in range(2)]
    model = model_with([0.2, 0.8], means, covariances)
    for mean, covariance in zip(means, covariances, strict=True):
        assert_is_conditional(model, mean, covariance, mean[:5] + 0.3, atol=1e-9)


def test_density_of_the_output_is_that_of_the_joint_over_that_of_the_input():
    """Mean and deviation by integrating p(x, y) / p(x) on a grid, with scipy's own densities."""
    rng = np.random.default_rng(2)
    weights = np.array([0.5, 0.3, 0.2])
    means, covariances = rng.normal(size=(3, 4)), np.array([random_covariance(rng, 4) for _ in range(3)])
    model = model_with(weights, means, covariances, inputs="position")
    x = np.array([0.4, -0.2])
    y = np.linspace(-25, 25, 20001)
    points = np.column_stack([np.broadcast_to(x, (len(y), 2)), y])
    parts = zip(weights, means[:, :3], covariances[:, :3, :3], strict=True)
    density = sum(w * multivariate_normal(m, c).pdf(points) for w, m, c in parts)
    density /= density.sum()
    (got,), (std,) = model.predict([x * model.input_scale])
    mean = (density * y).sum()
    assert got[0] / SCALE_M == pytest.approx(mean, abs=1e-6)
    assert std[0] / SCALE_M == pytest.approx(np.sqrt((density * (y - mean) ** 2).sum()), abs=1e-6)


def test_far_from_all_components_the_prediction_is_finite_and_linear():
    rng = np.random.default_rng(3)
    model = model_with([0.5, 0.5], rng.normal(size=(2, 7)), [random_covariance(rng, 7) for _ in range(2)])
    away = np.ones(5) * model.input_scale
    mean, std = model.predict([d * away for d in (1000.0, 2000.0, 3000.0)])
    assert np.isfinite(mean).all()
    assert np.isfinite(std).all()
    np.testing.assert_allclose(mean[2] - mean[1], mean[1] - mean[0], rtol=1e-9)


def test_the_mixture_finds_clusters_that_are_known():
    """Expectation maximisation against the truth: means, weights and covariances of two far clusters."""
    rng = np.random.default_rng(4)
    ground_truth = [random_covariance(rng, 3) for _ in range(2)]
    clusters = zip(([0, 0, 0], [40, 0, 0]), ground_truth, (6000, 2000), strict=True)
    joint = np.vstack([rng.multivariate_normal(*cluster) for cluster in clusters])
    mixture = fit_mixture(joint, 2, seed=0)
    order = np.argsort(mixture.means_[:, 0])
    np.testing.assert_allclose(mixture.weights_[order], [0.75, 0.25], atol=1e-6)
    for component, rows in zip(order, (joint[:6000], joint[6000:]), strict=True):
        np.testing.assert_allclose(mixture.means_[component], rows.mean(axis=0), atol=1e-6)
        want = np.cov(rows.T, bias=True) + REGULARISATION * np.eye(3)
        np.testing.assert_allclose(mixture.covariances_[component], want, atol=1e-6)


def test_two_ways_of_acting_need_two_components():
    """Forward while high, down while low: one plane cannot be both, and the criterion sees it."""
    rng = np.random.default_rng(5)
    heights = np.concatenate([rng.uniform(0.3, 0.4, 60), rng.uniform(0.0, 0.1, 60)])
    seen = [observe(rng.uniform(0, 0.1), z) for z in heights]
    moves = np.where(heights[:, None] > 0.2, [0.008, 0.0], [0.0, -0.008]) + rng.normal(0, 2e-4, (120, 2))
    model = fit_with(fit, [episode_of(seen, moves)], "position", policy="gmr")
    assert model.n_points >= 2
    high, low = model.predict([[0.05, 0.35], [0.05, 0.05]])[0]
    np.testing.assert_allclose([high, low], [[0.008, 0.0], [0.0, -0.008]], atol=5e-4)
    assert model.heldout_rmse_m is None


def test_same_seed_same_model():
    first, again = (registry.train("gmr", demonstrations(HANGER), seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.covariances, again.covariances)
