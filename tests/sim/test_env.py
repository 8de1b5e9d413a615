"""The environments by gymnasium's own checker, and by what their rewards and infos promise."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from layflat.data.types import ACTION_LIMIT_M, GroundTruth
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.cloth.geometry import ClothGeometry
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.env import ClothPlaceEnv
from layflat.sim.errors import SimError
from layflat.sim.registration import MAX_EPISODE_STEPS, register_environments
from layflat.sim.reward import potential
from layflat.sim.starts.base import home_corners
from layflat.tests.sim.helpers import fresh_process_outputs, set_nodes, simulation

register_environments()
IDS = ["layflat/HangerPlace-v0", "layflat/PickersPlace-v0"]
MAKE = "env = gymnasium.make('layflat:layflat/ClothPlace-v0', robot='pickers', cloth='napkin', task='smooth')"


@pytest.fixture(scope="module")
def env() -> Iterator[ClothPlaceEnv]:
    made = ClothPlaceEnv("pickers", cloth="napkin", noise=False, render_mode="rgb_array")
    yield made
    made.close()


@pytest.mark.timeout(200)
@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_checker_has_nothing_to_say(name: str) -> None:
    """Its checks of determinism run too: in the air even one process repeats itself bit by bit."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = gymnasium.make(name, render_mode="rgb_array")
        assert made.spec is not None
        assert made.spec.max_episode_steps == MAX_EPISODE_STEPS
        check_env(made.unwrapped)
        made.close()


SHOW = f"{MAKE}; s = env.unwrapped.simulation.spec; print(s.robot, s.cloth, s.task, sep='/')"


@pytest.mark.parametrize(
    ("script", "output"),
    [
        (f"import gymnasium; {SHOW}", "pickers/napkin/smooth"),
        (f"import layflat, gymnasium; {SHOW}", "pickers/napkin/smooth"),
        ("import sys, layflat; print('gymnasium' in sys.modules or 'pybullet' in sys.modules)", "False"),
    ],
)
def test_one_id_makes_every_environment_and_importing_layflat_imports_no_gymnasium(script: str, output: str) -> None:
    assert fresh_process_outputs(script, []) == [output]


@pytest.mark.parametrize("name", IDS)
def test_two_processes(name: str) -> None:
    vector = gymnasium.make_vec(name, num_envs=2, vectorization_mode="async", cloth="napkin")
    try:
        seen, info = vector.reset(seed=[7, 8])
        assert seen["corner_positions"].shape == (2, 6)
        assert np.abs(seen["holder_position"][0] - seen["holder_position"][1]).max() > 1e-4
        assert info["seed"].tolist() == [7, 8]
        _, rewards, ended, cut, _ = vector.step(np.zeros(vector.action_space.shape, np.float32))
        assert rewards.shape == (2,)
        assert not (ended | cut).any()
    finally:
        vector.close()


def test_rewards_add_up_to_the_gain_of_contact(env: ClothPlaceEnv) -> None:
    """A step at a time, lowered until some of it touches."""
    first, _ = env.reset(seed=0)
    total = 0.0
    for step_index in range(18):
        before = env.simulation.robot.position()
        seen, reward, terminated, truncated, info = env.step(np.array([0.5, 0.0, -0.7] * 2, np.float32))
        if step_index == 0:
            moved = env.simulation.robot.position() - before
            np.testing.assert_allclose(moved, np.array([0.5, 0.0, -0.7]) * ACTION_LIMIT_M, atol=1e-6)
        total += reward
        assert env.observation_space.contains(seen)
        assert (terminated, truncated) == (False, False)
    assert total == pytest.approx(float(seen["contact_portion"][0] - first["contact_portion"][0]))
    assert total > 0.01
    assert info["contact_portion_true"] > 0.01
    assert info["unstable"] == ""
    assert info["is_success"] is False


def test_a_diverged_cloth_ends_the_episode_and_says_why(env: ClothPlaceEnv) -> None:
    env.reset(seed=0)
    nodes = env.simulation.cloth.nodes().copy()
    nodes[100] += [3.0, 0.0, 0.0]
    set_nodes(env.simulation.cloth, nodes)
    seen, reward, terminated, _, info = env.step(np.zeros(6, np.float32))
    assert terminated
    assert reward == 0.0
    assert info["unstable"]
    assert info["is_success"] is False
    assert env.observation_space.contains(seen)
    assert {value.dtype for value in seen.values()} == {np.dtype(np.float32)}


@pytest.mark.parametrize("wrong", [np.full(6, np.nan), np.full(6, np.inf), np.zeros(2), np.zeros((2, 3))])
def test_wrong_actions_are_refused_and_change_nothing_and_the_image_shows_something(
    env: ClothPlaceEnv, wrong: np.ndarray
) -> None:
    env.reset(seed=1)
    with pytest.raises(SimError, match="6 finite numbers"):
        env.step(wrong.astype(np.float32))
    assert env.simulation.time_s == 0.0
    picture = env.render()
    assert picture is not None
    assert (picture.shape, picture.dtype) == ((480, 640, 3), np.uint8)
    assert picture.std() > 10


def test_resets_without_a_seed_follow_from_the_last_seed(env: ClothPlaceEnv) -> None:
    seeds = []
    for _ in range(2):
        env.reset(seed=4)
        seeds.append(env.reset()[1]["seed"])
    assert seeds[0] == seeds[1] == int(np.random.default_rng(4).integers(2**31))


def test_a_disturbance_comes_at_its_step_of_every_episode_and_images_when_asked_for() -> None:
    made = ClothPlaceEnv("pickers", cloth="napkin", images=True, disturbance="wind", disturb_step=2)
    for seed in range(2):
        seen, _ = made.reset(seed=seed)
        assert made.observation_space.contains(seen)
        assert seen["rgb"].shape == (*seen["depth"].shape[:2], 3)
        heard = []
        for _ in range(4):
            made.step(np.zeros(6, np.float32))
            heard.append(made.simulation.disturbed)
        assert heard == [False, False, True, True]
    made.close()


def test_a_hanging_start_is_the_programs_to_the_bit() -> None:
    made = ClothPlaceEnv("pickers", cloth="napkin", start="hanging", noise=False)
    made.reset(seed=8)
    with simulation("pickers", 8, cloth="napkin") as program:
        np.testing.assert_array_equal(made.simulation.ground_truth().nodes, program.ground_truth().nodes)
    made.close()


def test_rewards_of_a_demonstration_that_ends_where_the_cloth_is_flat() -> None:
    """Both start below 0.1 and add up to what the episode gained; the shaped one pays from the first step on."""
    made = ClothPlaceEnv("pickers", cloth="napkin", reward="shaped", terminate_on_success=True)
    made.reset(seed=8)
    spec = made.simulation.config.cloth_spec
    begin = potential(made.simulation.ground_truth(), spec)
    policy = PolicySpec(builtin=SCRIPTED).make(made.simulation)
    policy.reset(8)
    rewards, ended, info = [], False, {"is_success": False}
    while not ended and len(rewards) < 150:
        assert info["is_success"] is False
        action = policy.act(made.simulation.observe()).action / ACTION_LIMIT_M
        _, reward, ended, _, info = made.step(action.astype(np.float32))
        rewards.append(reward)
    assert ended
    assert info["is_success"] is True
    assert 0.05 < begin < 0.15
    assert begin + sum(rewards) == pytest.approx(potential(made.simulation.ground_truth(), spec))
    assert begin + sum(rewards) > 0.95
    assert sum(rewards[:10]) > 0.02
    made.close()


def test_a_heap_is_worth_more_than_a_hanging_cloth_and_less_than_half_a_flat_one() -> None:
    spec = cloth_spec("napkin")
    geometry = ClothGeometry(spec)
    hanging = spec.hanging_nodes(home_corners(spec))
    heap = hanging * [1.0, 1.0, 0.06]
    half = spec.flat_nodes()
    half[:, 2] = np.maximum(half[:, 0] - 0.14, 0.004)
    values = []
    for nodes in (hanging, heap, half, spec.flat_nodes()):
        truth = GroundTruth(nodes=nodes, contact_portion_true=0.0, flat_area=geometry.flat_area(nodes))
        values.append(potential(truth, spec))
    assert values == sorted(values)
    assert values[1] < 0.3 < values[2] - 0.1
    assert values[3] == pytest.approx(1.0, abs=0.01)


def test_a_reward_that_knows_the_mesh_is_lost_with_a_cloth_that_comes_apart() -> None:
    made = ClothPlaceEnv("pickers", cloth="napkin", reward="shaped")
    made.reset(seed=0)
    before = potential(made.simulation.ground_truth(), made.simulation.config.cloth_spec)
    nodes = made.simulation.cloth.nodes().copy()
    nodes[100] += [3.0, 0.0, 0.0]
    set_nodes(made.simulation.cloth, nodes)
    assert made.step(np.zeros(6, np.float32))[1] == pytest.approx(-before)
    made.close()


@pytest.mark.parametrize(
    "wrong",
    [
        {"reward": "gold"},
        {"start": "lying"},
        {"cloth": "silk"},
        {"render_mode": "human"},
        {"disturbance": "earthquake"},
    ],
)
def test_impossible_environments_are_refused(wrong: dict) -> None:
    with pytest.raises(SimError, match=r"gold|lying|silk|human|earthquake"):
        ClothPlaceEnv("hanger", **wrong)
