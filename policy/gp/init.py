"""Start of the optimiser of hyperparameters, found once for all outputs because they share their inputs.

With K = variance (R(l) + rho I), R(l) = U S U^T, and rho the noise over the variance, the likelihood of every output
for every rho and the best variance follow from one decomposition for each length scale l:

    variance = sum_i (u_i^T y)^2 / (s_i + rho) / N
    -log p   = (N log variance + sum_i log(s_i + rho) + N) / 2 + constant

A grid over l and rho thus costs one decomposition for each l, however many outputs there are. On ten demonstrations
with either robot, one run of the optimiser from here ended where the likelier of two runs from elsewhere ended.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from layflat.data.arrays import FloatArray

LENGTH_SCALES = np.geomspace(0.15, 4.0, 14)
NOISE_RATIOS = np.geomspace(1e-5, 1.0, 16)
MIN_VARIANCE = 1e-12
"""Lower bound of the variance: targets that are all zero have none."""


def best_start(inputs: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return length scale, variance and noise, (A,) each, of the likeliest point of the grid.

    For scaled inputs (N, D) and targets (N, A). Costs N^3 for each of LENGTH_SCALES, so N should be a few hundred.
    """
    count, outputs = targets.shape
    squared = cdist(inputs, inputs, "sqeuclidean")
    best = np.full(outputs, np.inf)
    found = np.ones((3, outputs))
    for length in LENGTH_SCALES:
        values, vectors = np.linalg.eigh(np.exp(-0.5 * squared / length**2))
        power = (vectors.T @ targets) ** 2
        for ratio in NOISE_RATIOS:
            spread = np.maximum(values, 0.0) + ratio
            variance = np.maximum((power / spread[:, np.newaxis]).mean(axis=0), MIN_VARIANCE)
            cost = 0.5 * (count * np.log(variance) + np.log(spread).sum())
            better = cost < best
            best[better] = cost[better]
            found[:, better] = np.stack([np.full(outputs, length), variance, ratio * variance])[:, better]
    length, variance, noise = found
    return length, variance, noise
