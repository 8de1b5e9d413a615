from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from layflat.policy.gp.kernel import JITTER, Hyperparameters, held_out_errors, weights
from layflat.policy.gp.model import GpModel
from layflat.tests.factories import HANGER, ROBOT_SPECS
from layflat.tests.policy.factories import gp_model, observe


def random_problem(seed: int, points: int, dims: int, ard: bool) -> tuple[np.ndarray, np.ndarray, Hyperparameters]:
    rng = np.random.default_rng(seed)
    inputs, targets = rng.normal(size=(points, dims)), rng.normal(size=(points, 2))
    lengths = rng.uniform(0.4, 2.5, (2, dims if ard else 1))
    variance, noise = rng.uniform(0.3, 3.0, 2), rng.uniform(1e-3, 0.1, 2)
    lengths = np.broadcast_to(lengths, (2, dims))
    kernel = "se-ard" if ard else "se"
    return inputs, targets, Hyperparameters(kernel=kernel, length_scales=lengths, variance=variance, noise=noise)


def oracle(hyper: Hyperparameters, output: int) -> GaussianProcessRegressor:
    """scikit-learn at the same hyperparameters."""
    kernel = ConstantKernel(hyper.variance[output]) * RBF(hyper.length_scales[output])
    return GaussianProcessRegressor(kernel, alpha=hyper.noise[output] + JITTER, optimizer=None)


def targets_of(model: GpModel, output: int) -> np.ndarray:
    """Targets of the training, from scikit-learn's kernel and the model's weights."""
    scaled = model.inputs / model.input_scale
    regressor = oracle(model.hyper, output)
    kernel = regressor.kernel(scaled) + regressor.alpha * np.eye(len(scaled))
    return kernel @ model.alpha[output]


@pytest.mark.parametrize("robot", ROBOT_SPECS)
@pytest.mark.parametrize("inputs", ["position", "all"])
def test_posterior_is_that_of_scikit_learn(robot, inputs):
    model = gp_model(robot, inputs, points=40)
    queries = np.random.default_rng(9).uniform(-0.5, 0.8, (30, model.layout.size))
    mean, std = model.predict(queries)
    for a in range(len(model.outputs)):
        regressor = oracle(model.hyper, a).fit(model.inputs / model.input_scale, targets_of(model, a))
        want, spread = regressor.predict(queries / model.input_scale, return_std=True)
        np.testing.assert_allclose(mean[:, a] / model.output_scale_m, want, atol=1e-9)
        np.testing.assert_allclose((std[:, a] / model.output_scale_m) ** 2, spread**2 + model.hyper.noise[a], atol=1e-9)


@pytest.mark.parametrize("ard", [False, True])
def test_held_out_errors_are_those_of_models_trained_without_the_group(ard):
    inputs, targets, hyper = random_problem(3, 36, 3, ard)
    groups = np.repeat([4, 1, 9], [10, 20, 6])
    errors = held_out_errors(inputs, targets, groups, hyper)
    for group in (4, 1, 9):
        out = groups == group
        for a in range(2):
            regressor = oracle(hyper, a).fit(inputs[~out], targets[~out, a])
            np.testing.assert_allclose(errors[out, a], targets[out, a] - regressor.predict(inputs[out]), atol=1e-8)


def test_held_out_errors_of_a_single_demonstration_are_the_targets():
    inputs, targets, hyper = random_problem(5, 15, 2, False)
    np.testing.assert_allclose(held_out_errors(inputs, targets, np.zeros(15), hyper), targets, atol=1e-8)


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_far_from_the_data_the_mean_fades_and_the_deviation_is_the_priors(robot):
    model = gp_model(robot)
    start = model.inputs[0]
    away = np.ones(model.layout.size) / np.sqrt(model.layout.size) * model.input_scale
    mean, std = model.predict([start + d * away for d in (0, 5, 8, 30)])
    norms = np.linalg.norm(mean, axis=1)
    assert norms[-1] < 1e-12 < norms[0]
    assert norms[2] < norms[0]
    np.testing.assert_allclose(std[-1], model.prior_std, rtol=1e-9)
    assert (std <= model.prior_std * (1 + 1e-12)).all()
    assert (std[0] < 0.5 * model.prior_std).all()


def test_deviation_never_falls_below_the_noise():
    model = gp_model(points=60)
    _, std = model.predict(model.inputs)
    assert (std >= model.output_scale_m * np.sqrt(model.hyper.noise)).all()


def test_small_noise_goes_through_the_points():
    inputs, targets, hyper = random_problem(7, 12, 2, False)
    inputs = 4 * inputs  # further apart than the length scales, else the matrix is too close to singular to tell
    sure = replace(hyper, noise=np.full(2, 1e-9))
    alpha = weights(inputs, targets, sure)
    for a in range(2):
        np.testing.assert_allclose(oracle(sure, a).kernel(inputs) @ alpha[a], targets[:, a], atol=1e-4)


def test_baseline_is_blind_to_the_cloth_and_gp_word_is_not():
    flat = observe(0.1, 0.1, contact=1.0)
    stirred = observe(0.1, 0.1, contact=0.5, word=(0.6, 0.8))
    for inputs, blind in (("position", True), ("all", False)):
        model = gp_model(HANGER, inputs)
        outputs = [model.predict(model.layout.vector(o)[np.newaxis])[0] for o in (flat, stirred)]
        assert np.array_equal(*outputs) is blind


def test_arrays_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        gp_model().alpha[0, 0] = 1.0
