"""The toy of a goal in the plane: who still gets there, the farther from the demonstrations it begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.policy.base import Policy
from layflat.policy.gp import finishing_policy, fit
from layflat.policy.gp.finishing_policy import FinishingPolicy
from layflat.policy.model_policy import ModelPolicy
from layflat.policy.stopping import AnyOf
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import episode_of, fit_with, gp_model, observe

GOAL = np.array([0.4, 0.02])
STARTS = 20
REACHED_M = 0.02
DISTANCES = (0, 1, 3, 8)
"""Of a start from the demonstrations, in length scales of the process."""


def towards(place: np.ndarray) -> np.ndarray:
    """A demonstrator's move: down first, then forward, slower near the goal."""
    gap = GOAL - place
    bent = gap * np.array([0.4 if place[1] > 0.1 else 1.0, 1.0])
    return 0.012 * bent / max(float(np.linalg.norm(bent)), 0.05)


@pytest.fixture(scope="module")
def model():
    episodes = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        place = np.array([0.0, 0.4]) + rng.normal(0, 0.02, 2)
        seen, moves = [], []
        for _ in range(60):
            seen.append(observe(*place))
            moves.append(towards(place) + rng.normal(0, 2e-4, 2))
            place = place + moves[-1]
        episodes.append(episode_of(seen, np.array(moves), seed=seed))
    return fit_with(fit.fit, episodes, "position", policy="gp-finish")


def starts(model, distance: float) -> np.ndarray:
    """(STARTS, 2) m, each so many length scales from the nearest demonstrated place."""
    rng, found = np.random.default_rng(9), []
    length_m = float(model.hyper.length_scales.mean() * model.input_scale[0])
    while len(found) < STARTS:
        anchor = model.inputs[rng.integers(0, model.n_points // 2)]
        angle = rng.uniform(0, 2 * np.pi)
        place = anchor + distance * length_m * np.array([np.cos(angle), np.sin(angle)])
        gap = np.linalg.norm(model.inputs - place, axis=1).min()
        if abs(gap - distance * length_m) <= 0.1 * length_m:
            found.append(place)
    return np.array(found)


def reaches(policy: Policy, place: np.ndarray, n_steps: int = 400) -> bool:
    policy.reset(0)
    for _ in range(n_steps):
        decision = policy.act(observe(*place))
        if decision.stop is not None:
            return False
        place = place + decision.action
        if np.linalg.norm(place - GOAL) < REACHED_M:
            return True
    return False


def test_the_mean_alone_fades_and_this_does_not(model):
    """In the order of the table in docs/explanation/policies.md: the mean fails the more the farther it begins."""
    thesis = ModelPolicy(replace(model, stop_threshold_m=1e-9), guard=AnyOf())
    mine = FinishingPolicy(model, stop=AnyOf())
    alone, ours = (
        [np.mean([reaches(policy, start) for start in starts(model, d)]) for d in DISTANCES]
        for policy in (thesis, mine)
    )
    assert ours == [1.0] * len(DISTANCES)
    assert alone[0] == 1.0
    assert alone[-1] < 0.3
    assert list(alone) == sorted(alone, reverse=True)


def test_near_the_demonstrations_it_follows_the_processes(model):
    policy = FinishingPolicy(model, stop=AnyOf())
    useful = np.linalg.norm(HANGER.pack([finishing_policy.USEFUL_M, 0.0, 0.0]))
    places = model.inputs + 0.003
    near = places[np.linalg.norm(model.predict(places)[0], axis=1) >= useful]
    assert len(near) > 20
    for place in near[::7]:
        decision = policy.act(observe(*place))
        want, std = model.predict([place])
        np.testing.assert_allclose(decision.action, want[0], atol=1e-12)
        np.testing.assert_allclose(decision.std, std[0], atol=1e-12)
        assert "scales from" not in decision.reason


@pytest.mark.parametrize("away_m", [0.2, 1.0, 20.0])
def test_outside_it_queries_at_the_radius_moves_back_and_says_so(model, away_m):
    policy = FinishingPolicy(model, stop=AnyOf())
    place = model.inputs[0] + np.array([-away_m, away_m])
    near = policy.nearest(place)
    gaps = np.linalg.norm((model.inputs - near.query) / model.input_scale, axis=1)
    assert gaps.min() == pytest.approx(finishing_policy.RADIUS, abs=1e-9)
    homeward = model.inputs[np.linalg.norm(model.inputs - place, axis=1).argmin()] - place
    assert near.way_back @ homeward > 0
    decision = policy.act(observe(*place))
    assert decision.action @ homeward > 0
    assert "scales from the demonstrations" in decision.reason


def test_on_the_table_nothing_is_pushed_back(model):
    """The way back to the demonstrations leads over cloth that lies there."""
    policy = FinishingPolicy(model, stop=AnyOf())
    assert policy.act(observe(0.7, 0.02, contact=0.85)).action[0] >= 0
    assert policy.act(observe(0.7, 0.02, contact=0.1)).action[0] < 0


def test_it_makes_a_useful_move_until_the_cloth_is_flat(model):
    still = FinishingPolicy(replace(model, alpha=1e-6 * model.alpha), stop=AnyOf())
    wrinkled = still.act(observe(*GOAL, contact=0.9))
    np.testing.assert_allclose(wrinkled.action, HANGER.pack([finishing_policy.USEFUL_M, 0.0, 0.0]), atol=1e-9)
    assert not still.act(observe(*GOAL, contact=0.995)).action.any()


def test_a_held_edge_that_hovers_over_the_table_is_drawn_down():
    """To the height of the flat cloth in the demonstrations; never up, slowly, and not while it is laid."""
    model = gp_model(HANGER, "all")
    points = model.inputs.copy()
    points[:, 1], points[:, 4] = 0.3, 0.4
    points[:5, 1], points[:5, 4] = 0.008, 1.0
    policy = FinishingPolicy(replace(model, inputs=points, alpha=0 * model.alpha), stop=AnyOf())
    for z, want in ((0.018, finishing_policy.PULL * (0.008 - 0.018)), (0.004, 0.0), (0.3, -finishing_policy.USEFUL_M)):
        assert policy.act(observe(0.2, z, contact=0.9)).action[1] == pytest.approx(want, abs=1e-9)


def test_a_landing_is_as_fast_as_in_the_demonstrations():
    """Nothing is added to what the processes say on the table, where they say something."""
    model = gp_model(HANGER, "all")
    points = model.inputs.copy()
    points[:5, 1], points[:5, 4] = 0.008, 1.0
    model = replace(model, inputs=points)
    landing = next(point for point in points[5:] if np.linalg.norm(model.predict([point])[0]) > 0.006)
    seen = observe(landing[0], landing[1], contact=0.85)
    policy = FinishingPolicy(model, stop=AnyOf())
    near = policy.nearest(model.layout.vector(seen))
    mean = model.predict([near.query])[0][0]
    assert np.linalg.norm(mean) >= finishing_policy.USEFUL_M
    limit = model.action_limit_m
    np.testing.assert_allclose(policy.act(seen).action, np.clip(mean, -limit, limit), atol=1e-12)


def test_it_says_whether_it_is_flat_or_nothing_helps(model):
    for contact, word in ((0.995, "has reached"), (0.9, "no gain")):
        policy = FinishingPolicy(model)
        policy.reset(0)
        stops = [policy.act(observe(*GOAL, contact=contact)) for _ in range(40)]
        stop = next(d for d in stops if d.stop is not None)
        assert stop.stop == "converged"
        assert word in stop.reason
        assert not stop.action.any()
    hanging = FinishingPolicy(model)
    assert all(hanging.act(observe(0.001 * k, 0.4)).stop is None for k in range(60))


def test_it_gives_up_where_it_pulls_and_nothing_yields(model):
    """A heap of cloth that has less contact than any gain counts from, and holds the holder back."""
    policy = FinishingPolicy(model)
    policy.reset(0)
    decisions = [policy.act(observe(0.3 + 0.0001 * k, 0.1, contact=0.1)) for k in range(finishing_policy.STUCK_STEPS)]
    assert all(decision.stop is None for decision in decisions[:-1])
    assert decisions[-1].stop == "converged"
    assert "stayed within" in decisions[-1].reason
