"""The simulation as an environment: starts, steps, and determinism across processes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from layflat.policy.environment import Environment
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import THESIS_ROBOTS
from layflat.sim.simulation import ClothSimulation
from layflat.sim.starts.base import home_corners
from layflat.sim.starts.hanging import START_MOVES
from layflat.tests.sim.helpers import fresh_process_outputs, simulation

_SCRIPT = """
import sys, hashlib, numpy as np
from layflat.tests.sim.helpers import simulation
robot, cloth, start, seed = *sys.argv[1:4], int(sys.argv[4])
rng, lowest = np.random.default_rng(seed), 1.0
with simulation(robot, seed, cloth=cloth, **({"task": "smooth"} if start == "crumpled" else {"start": start})) as sim:
    for k in range(15):
        if start == "folded-corner":
            if k == 3:
                sim.disturb("thesis")
            sim.drag(40, rng.uniform([0, -0.2, 0], [0.3, 0.2, 0.1])) if k < 9 else sim.release()
        down = [0.006, 0.0, -0.011] if start == "hanging" else [0.002, 0.0, 0.0]
        sim.step(sim.spec.robot.pack(down) + rng.uniform(-0.001, 0.001, sim.spec.robot.size))
        lowest = min(lowest, sim.ground_truth().nodes[:, 2].min())
    assert sim.divergence_reason() is None and lowest < 0.006, lowest
    print(hashlib.sha256(sim.ground_truth().nodes.tobytes() + sim.force_n().tobytes()).hexdigest())
"""


@pytest.mark.parametrize(
    ("robot", "cloth", "start"),
    [
        ("hanger", "towel", "hanging"),
        ("pickers", "napkin", "hanging"),
        ("hanger", "napkin", "folded-corner"),
        pytest.param("pickers", "towel", "crumpled", marks=pytest.mark.slow),
    ],
)
def test_the_same_seed_in_fresh_processes_gives_the_same_bits(robot: str, cloth: str, start: str) -> None:
    """Through the start, the descent and the first contact with the table, or a disturbance and drags."""
    scene = (robot, cloth, start)
    first, second, other = fresh_process_outputs(_SCRIPT, *((*scene, seed) for seed in ("201", "201", "202")))
    assert first == second != other


@pytest.fixture(scope="module", params=THESIS_ROBOTS)
def started(request: pytest.FixtureRequest) -> Iterator[ClothSimulation]:
    with simulation(request.param, 5, cloth="towel", camera=True) as sim:
        yield sim


def test_it_is_an_environment(started: ClothSimulation) -> None:
    environment: Environment = started
    spec, cloth = environment.spec, started.config.cloth_spec
    assert (spec.robot.name, spec.cloth, spec.task, spec.physics) == (started.config.robot, "towel", "place", "bullet")
    assert spec.cloth_shape is not None
    assert (spec.cloth_shape.rows, spec.cloth_shape.held_width_m) == (cloth.rows, cloth.held_width_m)
    assert spec.config["start"] == "hanging"
    assert environment.joint_angles().shape == ((7,) if spec.robot.n_points == 1 else (0,))
    assert environment.start["table_friction"] == 1.0
    assert not environment.disturbed
    assert not environment.force_n().any()


def test_a_start_hangs_free_of_the_table_near_home(started: ClothSimulation) -> None:
    spec, home = started.config.cloth_spec, home_corners(started.config.cloth_spec)
    ground_truth, seen = started.ground_truth(), started.observe()
    assert started.time_s == ground_truth.contact_portion_true == ground_truth.flat_area == 0.0
    assert ground_truth.nodes[:, 2].min() > 0.03
    assert np.abs(seen.corner_positions - home).max() < START_MOVES * started.robot.start_step_m
    held = np.linalg.norm(np.diff(seen.corner_positions, axis=0))
    assert held == pytest.approx(spec.held_width_m, rel=0.05 if started.config.robot == "pickers" else 0.005)
    np.testing.assert_allclose(ground_truth.nodes[list(spec.corners)], seen.corner_positions, atol=0.002)
    assert seen.contact_portion == pytest.approx(0.0, abs=0.02)
    assert seen.rgb is not None
    assert seen.depth is not None
    assert seen.rgb.shape == (*seen.depth.shape, 3)
    assert started.observe(images=False).rgb is None
    assert started.divergence_reason() is None


def test_a_step_is_a_tenth_of_a_second_and_moves_the_robot(started: ClothSimulation) -> None:
    before, time_s = started.observe(images=False).holder_position, started.time_s
    for _ in range(4):
        started.step(started.spec.robot.pack([0.0, 0.0, 0.008]))
    assert started.time_s - time_s == pytest.approx(0.4)
    risen = started.observe(images=False).holder_position - before
    assert risen[2] == pytest.approx(0.032, abs=0.008)  # the arm lags; the pickers do not
    assert np.abs(risen[:2]).max() < 0.008


def test_starts_differ_by_seed_and_repeat_in_one_process() -> None:
    """In the air nothing touches itself, so that even one process repeats a start bit by bit."""
    nodes = []
    with simulation(seed=None) as sim:
        for seed in (1, 2, 1):
            sim.reset(seed)
            nodes.append(sim.ground_truth().nodes)
    assert nodes[0].tobytes() == nodes[2].tobytes()
    assert np.abs(nodes[0] - nodes[1]).max() > 0.001


def test_without_a_reset_nothing_can_be_done() -> None:
    with simulation(seed=None) as sim:
        calls = (sim.observe, sim.ground_truth, lambda: sim.step(np.zeros(6)), lambda: sim.guide(None))
        for call in (*calls, lambda: sim.disturb("push")):
            with pytest.raises(SimError, match="reset"):
                call()


@pytest.mark.slow
@pytest.mark.parametrize("robot", THESIS_ROBOTS)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_fine_mesh_survives_a_whole_demonstration(robot: str, seed: int) -> None:
    script = """
import sys, layflat
from layflat.tests.sim.helpers import simulation
with simulation(sys.argv[1], None, cloth="towel-fine", camera=True) as sim:
    episode = layflat.rollout(sim, layflat.load_policy("scripted"), seed=int(sys.argv[2]))
print(f"{episode.stopped_by}:{episode.final_ground_truth.flat_area}")
"""
    stopped_by, area = fresh_process_outputs(script, [robot, str(seed)])[0].split(":")
    assert stopped_by != "unstable"
    assert float(area) > 0.9
