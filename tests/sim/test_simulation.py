"""The bench: starts, determinism across processes, and a whole placement of the fine mesh."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from layflat.sim.cloth.spec import HELD_STRETCH
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.sim.simulation import ClothSimulation
from layflat.sim.starts.base import home_corners
from layflat.sim.starts.hanging import START_MOVES

_SCRIPT = """
import sys, hashlib, numpy as np
from layflat.sim.robots.registry import robot_spec
from layflat.sim.simulation import ClothSimulation
from layflat.sim.config import SimConfig
robot, cloth, seed = sys.argv[1], sys.argv[2], int(sys.argv[3])
bench = ClothSimulation(SimConfig(robot=robot, cloth=cloth, camera=False))
bench.reset(seed)
rng = np.random.default_rng(seed)
down = np.array([0.006, -0.011] if robot == "hanger" else [0.006, 0.0, -0.011] * 2)
lowest = 1.0
for _ in range(15):
    bench.step(down + rng.uniform(-0.001, 0.001, robot_spec(robot).size))
    lowest = min(lowest, bench.ground_truth().nodes[:, 2].min())
assert bench.divergence_reason() is None and lowest < 0.006, lowest
print(hashlib.sha256(bench.ground_truth().nodes.tobytes()).hexdigest())
"""


@pytest.mark.parametrize(("robot", "cloth"), [("hanger", "towel"), ("pickers", "napkin")])
def test_the_same_seed_in_fresh_processes_gives_the_same_bits(robot: str, cloth: str) -> None:
    """Through the start, the descent, and the first contact with the table."""
    running = [
        subprocess.Popen([sys.executable, "-c", _SCRIPT, robot, cloth, seed], stdout=subprocess.PIPE, text=True)
        for seed in ("3", "3", "4")
    ]
    digests = [process.communicate(timeout=100)[0].split()[-1] for process in running]
    assert digests[0] == digests[1] != digests[2]


@pytest.fixture(scope="module", params=ROBOTS)
def started(request: pytest.FixtureRequest) -> ClothSimulation:
    bench = ClothSimulation(SimConfig(robot=request.param))
    bench.reset(5)
    return bench


def test_a_start_hangs_free_of_the_table_near_home(started: ClothSimulation) -> None:
    spec, home = started.config.cloth_spec, home_corners(started.config.cloth_spec)
    ground_truth, seen = started.ground_truth(), started.observe()
    assert started.time_s == 0.0
    assert ground_truth.contact_portion_true == 0.0
    assert ground_truth.flat_area == 0.0
    assert ground_truth.nodes[:, 2].min() > 0.03
    assert np.abs(seen.corner_positions - home).max() < START_MOVES * started.robot.start_step_m
    held = np.linalg.norm(np.diff(seen.corner_positions, axis=0))
    assert held == pytest.approx(HELD_STRETCH * spec.width_m, rel=0.05 if started.config.robot == "pickers" else 0.005)
    np.testing.assert_allclose(ground_truth.nodes[list(spec.corners)], seen.corner_positions, atol=0.002)
    assert seen.contact_portion == pytest.approx(0.0, abs=0.02)
    assert started.divergence_reason() is None


def test_observations_keep_images_only_when_asked(started: ClothSimulation) -> None:
    assert started.observe(images=False).rgb is None
    seen = started.observe()
    assert seen.rgb is not None
    assert seen.depth is not None
    assert seen.rgb.shape == (*seen.depth.shape, 3)


def test_a_step_is_a_tenth_of_a_second_and_moves_the_holder(started: ClothSimulation) -> None:
    before, time_s = started.observe(images=False).holder_position, started.time_s
    up = np.zeros(robot_spec(started.config.robot).size).reshape(-1, 2 if started.config.robot == "hanger" else 3)
    up[:, -1] = 0.008
    for _ in range(4):
        started.step(up.ravel())
    assert started.time_s - time_s == pytest.approx(0.4)
    risen = started.observe(images=False).holder_position - before
    assert risen[2] == pytest.approx(0.032, abs=0.008)  # the arm lags; the pickers do not
    assert np.abs(risen[:2]).max() < 0.008


def test_starts_differ_by_seed_and_repeat_in_one_process() -> None:
    """In the air nothing touches itself, so that even one process repeats a start bit by bit."""
    bench = ClothSimulation(SimConfig(robot="pickers", cloth="napkin", camera=False))
    nodes = []
    for seed in (1, 2, 1):
        bench.reset(seed)
        nodes.append(bench.ground_truth().nodes)
    bench.close()
    assert nodes[0].tobytes() == nodes[2].tobytes()
    assert np.abs(nodes[0] - nodes[1]).max() > 0.001


def test_a_bench_without_a_world_says_so() -> None:
    bench = ClothSimulation(SimConfig(robot="pickers"))
    with pytest.raises(SimError, match="reset"):
        bench.step(np.zeros(6))
    bench.close()


@pytest.mark.parametrize("wrong", [{"robot": "feet"}, {"cloth": "silk"}, {"step_s": 0.0}, {"step_s": 2.0}])
def test_impossible_settings_are_refused(wrong: dict) -> None:
    with pytest.raises(SimError, match=r"known ones|between"):
        SimConfig(**({"robot": "hanger"} | wrong))


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_fine_mesh_survives_a_whole_demonstration(robot: str, seed: int) -> None:
    script = (
        "import sys; from layflat.app.workers.episode_pool import EpisodeConfig, run_episode\n"
        "episode = run_episode(EpisodeConfig(robot=sys.argv[1], cloth='towel-fine', seed=int(sys.argv[2])))\n"
        "print(episode.stopped_by, episode.final_ground_truth.flat_area)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, robot, str(seed)], capture_output=True, text=True, check=True, timeout=600
    )
    stopped_by, area = done.stdout.split()
    assert stopped_by != "unstable"
    assert float(area) > 0.9
