"""Sparse form of a Gaussian process, for more steps than the full form can hold: M inducing points stand for N steps.

Titsias 2009, as in GPy's VarDTC. With L the lower factor of K_uu, s^2 the noise and K_uf between inducing points and
steps

    A = L^-1 K_uf / s        B = I + A A^T = L_B L_B^T
    alpha = L^-T L_B^-T L_B^-1 A y / s
    mean = k_u^T alpha       var = variance - |L^-1 k_u|^2 + |L_B^-1 L^-1 k_u|^2 + s^2

If every step is an inducing point, it is the full process.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from layflat.data.arrays import FloatArray
from layflat.policy.gp import kernel
from layflat.policy.gp.kernel import Hyperparameters


def inducing_points(scaled: FloatArray, count: int, seed: int) -> FloatArray:
    """Return (M, D) the centres of ``count`` clusters of the scaled inputs (N, D); the same for all outputs."""
    from sklearn.cluster import KMeans  # imported here because only training needs it

    if count >= len(scaled):
        return scaled
    return np.asarray(KMeans(count, n_init=1, random_state=seed).fit(scaled).cluster_centers_)


def compress(
    inducing: FloatArray, scaled: FloatArray, targets: FloatArray, hyper: Hyperparameters
) -> tuple[FloatArray, FloatArray]:
    """Return alpha (A, M) and L_B (A, M, M) for scaled inducing points (M, D), inputs (N, D) and targets (N, A)."""
    alphas, inners = [], []
    for a in range(targets.shape[1]):
        lower, white, noise_std = _whitened(inducing, scaled, hyper, a)
        inner = cholesky(np.eye(len(lower)) + white @ white.T, lower=True)
        half = _solve(inner, white @ targets[:, a] / noise_std)
        alphas.append(solve_triangular(lower, half, lower=True, trans=1))
        inners.append(inner)
    return np.array(alphas), np.array(inners)


def held_out_errors(
    inducing: FloatArray, scaled: FloatArray, targets: FloatArray, groups: np.ndarray, hyper: Hyperparameters
) -> FloatArray:
    """Return (N, A) targets minus the predictions of a model without each target's group; the rest stays the same."""
    errors = np.empty_like(targets)
    for a in range(targets.shape[1]):
        _, white, noise_std = _whitened(inducing, scaled, hyper, a)
        gram, power = white @ white.T, white @ targets[:, a]
        for label in np.unique(groups):
            own = groups == label
            inner = cholesky(np.eye(len(inducing)) + gram - white[:, own] @ white[:, own].T, lower=True)
            rest = (power - white[:, own] @ targets[own, a]) / noise_std
            # k_u^T L^-T is a step's own column of A, times s.
            errors[own, a] = targets[own, a] - noise_std * white[:, own].T @ _solve(inner, rest)
    return errors


def _whitened(
    inducing: FloatArray, scaled: FloatArray, hyper: Hyperparameters, output: int
) -> tuple[FloatArray, FloatArray, float]:
    """Return L (M, M), A (M, N) and s of one output."""
    lower = kernel.cholesky(inducing, hyper, output, noise=False)
    noise_std = float(np.sqrt(hyper.noise[output]))
    white = solve_triangular(lower, kernel.covariance(inducing, scaled, hyper, output), lower=True) / noise_std
    return lower, white, noise_std


def _solve(inner: FloatArray, right: FloatArray) -> FloatArray:
    """Return B^-1 right, by the factor of B."""
    half = solve_triangular(inner, right, lower=True)
    return np.asarray(solve_triangular(inner, half, lower=True, trans=1))
