"""Disturbances by what they do to the cloth: momentum, displacement, wrinkles; never that a call was made."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.sim.camera.camera import Camera
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.disturbances.controller import DisturbanceController
from layflat.sim.disturbances.presets import DISTURBANCES, DisturbanceSpec, disturbance_spec
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.physics.bullet.force_anchors import HAND_MASS_KG
from layflat.sim.robots.pickers import FreePickers
from layflat.tests.sim.helpers import cloth_in_world, n_bodies, run, set_nodes, small_cloth

SMALL = small_cloth()
FLYING = SMALL.flat_nodes(z_m=0.6)
SEEDS = st.integers(min_value=0, max_value=2**32 - 1)


def _started(cloth: BulletCloth, spec: DisturbanceSpec, seed: int = 0) -> DisturbanceController:
    return DisturbanceController(cloth, spec.sample(np.random.default_rng(seed), cloth.spec))


def _run(cloth: BulletCloth, disturbance: DisturbanceController, limit_s: float = 5.0) -> None:
    end = cloth.world.time_s + limit_s
    while not disturbance.done and cloth.world.time_s < end:
        disturbance.before_substep()
        cloth.world.step()


def _velocity(cloth: BulletCloth) -> np.ndarray:
    before = cloth.nodes().mean(axis=0)
    cloth.world.step()
    return np.asarray((cloth.nodes().mean(axis=0) - before) / cloth.world.substep_s)


def _steady_push(side: int, path: tuple[float, float], gravity_m_s2: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the momentum that a free cloth gained, less gravity's, and the logged impulse, N s.

    A target that runs away keeps the hands at their greatest force: half the cloth's weight for half a second.
    """
    spec = DisturbanceSpec(
        name="steady", kind="push", along=(0.5, 0.5), across=(0.5, 0.5), patch=(side, side), path=(path,),
        speed_m_s=5.0, force_weights=0.5, time_limit_s=0.5, settle_s=0.0,
    )  # fmt: skip
    with cloth_in_world(SMALL, FLYING + np.array([0.0, 0.0, 3.0])) as cloth:
        cloth.world.set_gravity((0.0, 0.0, gravity_m_s2))
        disturbance = _started(cloth, spec, 1)
        _run(cloth, disturbance)
        fallen = np.array([0.0, 0.0, gravity_m_s2 * (cloth.world.time_s + cloth.world.substep_s)])
        return SMALL.mass_kg * (_velocity(cloth) - fallen), disturbance.impulse_n_s


FORCE_TIME_N_S = 0.5 * SMALL.mass_kg * GRAVITY_M_S2 * 0.5


@pytest.mark.parametrize(
    ("side", "path", "tolerance"),
    [
        (1, (10.0, 0.0), 0.05),
        (1, (0.0, 10.0), 0.05),
        (1, (7.0, 7.0), 0.05),
        (3, (10.0, 0.0), 0.05),
        # A lifted patch drapes the cloth around it, and Bullet's damping takes a share of that motion's momentum.
        (3, (0.0, 10.0), 0.12),
        pytest.param(3, (0.0, 10.0), 0.05, marks=pytest.mark.xfail(strict=True, reason="a lifted patch loses 8 %")),
    ],
)
def test_momentum_is_force_times_time(side: int, path: tuple[float, float], tolerance: float) -> None:
    gained, impulse = _steady_push(side, path, 0.0)
    assert np.linalg.norm(gained - impulse) < tolerance * FORCE_TIME_N_S
    # The hands leave with their share.
    share = SMALL.mass_kg / (SMALL.mass_kg + side**2 * HAND_MASS_KG)
    wanted = share * FORCE_TIME_N_S * np.array([path[0], 0.0, path[1]]) / np.linalg.norm(path)
    assert np.linalg.norm(gained - wanted) < tolerance * FORCE_TIME_N_S


@pytest.mark.parametrize("path", [(0.0, 10.0), (10.0, 0.0)])
def test_momentum_is_the_logged_impulse_while_falling(path: tuple[float, float]) -> None:
    gained, impulse = _steady_push(1, path, -GRAVITY_M_S2)
    assert np.linalg.norm(impulse) > 0.5 * FORCE_TIME_N_S
    assert np.linalg.norm(gained - impulse) < 0.05 * np.linalg.norm(impulse)


def test_hands_follow_their_path() -> None:
    spec = replace(disturbance_spec("push"), heading_deg=(30.0, 30.0), settle_s=0.0)
    with cloth_in_world(SMALL, FLYING) as cloth:
        cloth.world.set_gravity((0.0, 0.0, 0.0))
        disturbance = _started(cloth, spec, 1)
        disturbance.before_substep()
        start = disturbance.hand_positions()
        assert len(start) == 9
        last = start
        while len(disturbance.hand_positions()):
            last = disturbance.hand_positions()
            cloth.world.step()
            disturbance.before_substep()
        moved = (last - start).mean(axis=0)
        wanted = 0.15 * SMALL.length_m * np.array([math.cos(math.pi / 6), math.sin(math.pi / 6), 0.0])
        assert np.linalg.norm((moved - wanted)[:2]) < 0.012


def test_nothing_is_left_behind_in_the_end_or_after_a_stop() -> None:
    with cloth_in_world(SMALL, SMALL.flat_nodes()) as cloth:
        bodies, gravity = n_bodies(cloth.world), cloth.world.gravity_m_s2
        for name in ("thesis", "wind", "none", "lift-drop"):
            disturbance = _started(cloth, replace(disturbance_spec(name), settle_s=0.05))
            if name == "lift-drop":
                _run(cloth, disturbance, 20 / 240)
                assert n_bodies(cloth.world) > bodies
                disturbance.stop()
            else:
                _run(cloth, disturbance)
                assert disturbance.done
            assert len(disturbance.hand_positions()) == 0
            assert n_bodies(cloth.world) == bodies
            assert cloth.world.gravity_m_s2 == gravity


def test_none_touches_nothing() -> None:
    results = []
    for disturbed in (False, True):
        with cloth_in_world(SMALL, SMALL.flat_nodes()) as cloth:
            disturbance = _started(cloth, disturbance_spec("none"))
            run(cloth.world, 24, *([disturbance.before_substep] if disturbed else []))
            assert disturbance.done == disturbed
            results.append(cloth.nodes())
    assert np.abs(results[0] - results[1]).max() < 1e-6


def test_wind_moves_the_cloth_by_half_a_t_squared() -> None:
    spec = replace(disturbance_spec("wind"), heading_deg=(90.0, 90.0), wind_m_s2=2.0, time_limit_s=0.5, settle_s=0.0)
    with cloth_in_world(SMALL, FLYING) as cloth:
        cloth.world.set_gravity((0.0, 0.0, 0.0))
        before = cloth.nodes().mean(axis=0)
        disturbance = _started(cloth, spec)
        run(cloth.world, round(0.5 / cloth.world.substep_s), disturbance.before_substep)
        moved = cloth.nodes().mean(axis=0) - before
        np.testing.assert_allclose(moved, [0.0, 0.5 * 2.0 * 0.5**2, 0.0], atol=0.05 * 0.25)
        np.testing.assert_allclose(disturbance.impulse_n_s, [0.0, SMALL.mass_kg * 2.0 * 0.5, 0.0], rtol=0.01, atol=1e-9)


@given(seed=SEEDS, name=st.sampled_from(sorted(DISTURBANCES)), cloth=st.sampled_from(["towel", "napkin"]))
def test_plans_repeat_and_spare_the_held_corners(seed: int, name: str, cloth: str) -> None:
    spec, fabric = disturbance_spec(name), cloth_spec(cloth)
    first, second = (spec.sample(np.random.default_rng(seed), fabric) for _ in range(2))
    assert first.nodes == second.nodes
    assert first.path_m.tobytes() == second.path_m.tobytes()
    assert not set(first.nodes) & set(fabric.corners)
    assert bool(first.nodes) == (spec.kind not in ("none", "wind"))
    assert all(0 <= node < fabric.rows * fabric.columns for node in first.nodes)
    if first.nodes:
        rows = np.array(first.nodes) // fabric.columns / (fabric.rows - 1)
        assert spec.along[0] - 0.1 <= rows.mean() <= spec.along[1] + 0.1
        assert first.force_limit_n == pytest.approx(spec.force_weights * fabric.mass_kg * GRAVITY_M_S2)


@given(seed=SEEDS)
def test_target_moves_at_its_speed_and_ends_at_the_paths_end(seed: int) -> None:
    plan = disturbance_spec("thesis").sample(np.random.default_rng(seed), SMALL)
    length = float(np.linalg.norm(np.diff(plan.path_m, axis=0), axis=1).sum())
    times = np.linspace(0.0, 1.2 * length / plan.speed_m_s, 200)
    offsets = np.array([plan.target(t)[0] for t in times])
    speeds = np.linalg.norm(np.diff(offsets, axis=0), axis=1) / np.diff(times)
    assert speeds.max() <= plan.speed_m_s * (1 + 1e-6)
    np.testing.assert_allclose(offsets[0], 0.0, atol=1e-12)
    np.testing.assert_array_equal(offsets[-1], plan.path_m[-1])
    assert plan.target(times[-1])[2]
    assert not plan.target(0.5 * length / plan.speed_m_s)[2]


def test_the_stick_makes_wrinkles_that_a_drag_pulls_out() -> None:
    spec = cloth_spec("napkin")
    with cloth_in_world(spec, spec.flat_nodes()) as cloth:
        held, nodes = spec.corners_at(spec.length_m, 0.004), spec.flat_nodes()
        nodes[list(spec.corners)] = held
        set_nodes(cloth, nodes)
        pickers = FreePickers(cloth, held)
        pickers.grasp()
        substeps = round(spec.rate_hz / 10)

        def step(dx: float, disturbance: DisturbanceController | None = None) -> None:
            pickers.start_step(np.array([dx, 0.0, 0.0] * 2), substeps)
            run(cloth.world, substeps, pickers.before_substep, *([disturbance.before_substep] if disturbance else []))

        camera = Camera(cloth, noise=None, seed=0)
        blank = PerceptionPipeline(camera.pinhole)
        perceiver = blank.with_flat_pixels(blank.perceive(*camera.capture(spec.flat_nodes())).cloth_pixels)

        def contact() -> float:
            return perceiver.perceive(*camera.capture()).contact_portion

        for _ in range(3):
            step(0.0)
        assert contact() > 0.97
        disturbance = _started(cloth, disturbance_spec("thesis"), 3)
        while not disturbance.done:
            step(0.0, disturbance)
        disturbed = cloth.nodes()
        assert cloth.divergence_reason(disturbed) is None
        after = contact()
        assert 0.74 < after < 0.94  # Table 4-2: 0.78 to 0.91
        assert cloth.flat_area(disturbed) > 0.85  # wrinkles, not a fold
        for _ in range(10):
            step(0.005)
        assert contact() > after + 0.05
