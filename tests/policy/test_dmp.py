from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.policy import registry
from layflat.policy.base import PolicyError, continue_after_disturbance
from layflat.policy.dmp import DAMPING, PHASE_RATE, STIFFNESS, DmpModel, DmpPolicy, basis, path
from layflat.policy.stopping import AnyOf
from layflat.tests.policy.factories import episode_of, observe

STEPS = 80


def spring(start: float, goal: float, u: np.ndarray) -> np.ndarray:
    """x'' = w^2 (g - x) - 2 w x' - w^2 (g - x0) exp(-a u) from rest at x0, solved by hand."""
    omega, gap = np.sqrt(STIFFNESS), start - goal
    particular = gap * omega**2 / (omega - PHASE_RATE) ** 2
    free, slope = gap - particular, PHASE_RATE * particular + omega * (gap - particular)
    return goal + particular * np.exp(-PHASE_RATE * u) + (free + slope * u) * np.exp(-omega * u)


def test_without_a_force_it_is_the_critically_damped_spring():
    assert pytest.approx(4 * STIFFNESS) == DAMPING**2
    u = np.arange(161) / STEPS
    start, goal = np.array([0.0, 0.4, 0.2]), np.array([0.4, 0.0, 0.2])
    got = path(start, goal, np.zeros((3, 25)), step_u=1 / STEPS, n_steps=160)
    want = np.column_stack([spring(a, b, u) for a, b in zip(start, goal, strict=True)])
    np.testing.assert_allclose(got, want, atol=1e-5 * 0.4)
    assert (np.diff(got[:, 0]) >= -1e-9).all()  # it never overshoots
    assert got[:, 0].max() <= 0.4 + 1e-9


def test_any_weights_end_at_the_goal():
    rng = np.random.default_rng(0)
    goal = np.array([0.5, 0.01])
    got = path(np.array([0.1, 0.4]), goal, rng.normal(0, 0.5, (2, 25)), step_u=1 / STEPS, n_steps=4 * STEPS)
    assert np.abs(got - goal).max() > 0.1
    np.testing.assert_allclose(got[-1], goal, atol=1e-5)


@pytest.mark.parametrize("u", [0.0, 0.3, 1.0, 5.0, 100.0])
def test_basis_functions_share_the_phase(u):
    s = np.exp(-PHASE_RATE * u)
    values = basis(s, 25)
    assert (values >= 0).all()
    assert values.sum() == pytest.approx(s)


def demonstration(*, x0: float = 0.0, x1: float = 0.45, n_steps: int = STEPS, seed: int = 0):
    """Down, then forward: a way with a bend, as the placing of a cloth has."""
    share = np.linspace(0, 1, n_steps + 1)
    smooth = share * share * (3 - 2 * share)
    x = x0 + (x1 - x0) * np.clip(1.6 * smooth - 0.6, 0, None)
    z = 0.4 * (1 - np.clip(1.6 * smooth, None, 1))
    seen = [observe(a, b) for a, b in zip(x, z, strict=True)]
    episode = episode_of(seen[:-1], np.column_stack([np.diff(x), np.diff(z)]), seed=seed)
    return replace(episode, final_observation=seen[-1]), np.column_stack([x, z])


def rolled_out(model: DmpModel, start, n_steps: int) -> np.ndarray:
    """(T + 1, 2) m: a holder that follows its commands."""
    policy = DmpPolicy(model, guard=AnyOf())
    policy.reset(0)
    places = [np.array(start, dtype=float)]
    for _ in range(n_steps):
        decision = policy.act(observe(*places[-1]))
        if decision.stop is not None:
            break
        places.append(places[-1] + decision.action)
    return np.array(places)


def test_reproduces_its_demonstration():
    episode, way = demonstration()
    model = registry.train("dmp", [episode])
    assert model.duration_s == pytest.approx(0.1 * STEPS)
    slow, fast = (demonstration(n_steps=n)[0] for n in (100, 50))
    assert registry.train("dmp", [slow, fast]).duration_s == pytest.approx(7.5)  # the mean
    got = rolled_out(replace(model, stop_threshold_m=1e-9), way[0], STEPS)
    assert len(got) == len(way)
    assert np.abs(got - way).max() < 0.004


def test_from_another_start_it_ends_at_the_mean_of_the_ends():
    episodes = [demonstration(x0=0.02 * k, x1=0.4 + 0.02 * k, seed=k)[0] for k in range(3)]
    model = registry.train("dmp", episodes)
    np.testing.assert_allclose(model.goal, [0.42, 0.0], atol=1e-9)
    got = rolled_out(replace(model, stop_threshold_m=1e-9), (-0.1, 0.45), 3 * STEPS)
    np.testing.assert_allclose(got[-1], [0.42, 0.0], atol=1e-4)
    assert model.heldout_rmse_m is not None
    assert max(model.heldout_rmse_m) < 0.004


def test_later_steps_make_up_for_what_the_limit_cuts_off():
    episode, way = demonstration()
    model = registry.train("dmp", [episode])
    slow = replace(model, action_limit_m=0.006, stop_threshold_m=1e-9)
    got = rolled_out(slow, way[0], 2 * STEPS)
    assert np.abs(np.diff(got, axis=0)).max() <= 0.006 + 1e-12
    np.testing.assert_allclose(got[-1], way[-1], atol=2e-3)


def test_it_stops_at_the_goal_and_stays_there_after_a_disturbance():
    """A trajectory knows nothing of the cloth: after a disturbance it stays where it is."""
    episode, way = demonstration()
    policy = DmpPolicy(registry.train("dmp", [episode]), guard=AnyOf())
    policy.reset(0)
    decisions = [policy.act(observe(*way[-1])) for _ in range(2 * STEPS)]
    assert next(d.stop for d in decisions if d.stop) == "threshold"
    continue_after_disturbance(policy)
    after = [policy.act(observe(*way[-1], contact=0.7)) for _ in range(20)]
    assert max(np.linalg.norm(d.action) for d in after) < policy.model.stop_threshold_m
    assert any(d.stop == "threshold" for d in after)


def test_a_demonstration_without_placing_is_refused():
    seen = [observe() for _ in range(12)]
    episode = episode_of(seen, np.zeros((12, 2)), phases=["place"] + ["repair"] * 11)
    with pytest.raises(PolicyError, match="seed 0 holds 1 steps of placing"):
        registry.train("dmp", [episode])
