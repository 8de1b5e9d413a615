from __future__ import annotations

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from layflat.policy.gp.fit import START_LENGTH_SCALES, START_NOISE_RATIOS, best_start


def problem(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    inputs = rng.uniform(-2, 2, (60, 2))
    ground_truth = np.column_stack([np.sin(2 * inputs[:, 0]), 0.2 * inputs[:, 1], np.zeros(60)])
    return inputs, ground_truth + rng.normal(0, [0.1, 0.02, 0.3], (60, 3))


def log_likelihood(inputs, target, length, variance, noise) -> float:
    kernel = ConstantKernel(variance) * RBF(length) + WhiteKernel(noise)
    regressor = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(inputs, target)
    return float(regressor.log_marginal_likelihood(regressor.kernel_.theta))


def test_it_is_the_likeliest_point_of_its_grid_by_scikit_learn():
    """Every other point of the grid, at any variance, is less likely for each output."""
    inputs, targets = problem(0)
    length, variance, noise = best_start(inputs, targets)
    rng = np.random.default_rng(1)
    for a in range(3):
        best = log_likelihood(inputs, targets[:, a], length[a], variance[a], noise[a])
        for _ in range(40):
            other, ratio = rng.choice(START_LENGTH_SCALES), rng.choice(START_NOISE_RATIOS)
            guess = variance[a] * np.exp(rng.normal())
            assert log_likelihood(inputs, targets[:, a], other, guess, ratio * guess) <= best + 1e-6
        for factor in (0.9, 1.1):
            scaled = log_likelihood(inputs, targets[:, a], length[a], factor * variance[a], factor * noise[a])
            assert scaled < best


def test_outputs_share_the_work_and_nothing_else():
    inputs, targets = problem(2)
    together = np.array(best_start(inputs, targets))
    for a in range(3):
        np.testing.assert_allclose(np.array(best_start(inputs, targets[:, [a]]))[:, 0], together[:, a])


def test_targets_of_zero_have_a_start():
    length, variance, noise = best_start(np.random.default_rng(0).normal(size=(20, 3)), np.zeros((20, 1)))
    for value in (length, variance, noise):
        assert np.isfinite(value).all()
        assert (value > 0).all()


def test_noise_alone_is_seen_as_noise():
    inputs, targets = problem(3)
    _, variance, noise = best_start(inputs, targets)
    assert noise[2] >= variance[2] * 0.3
    assert np.sqrt(noise[0]) == pytest.approx(0.1, rel=0.5)
