"""The environments by gymnasium's own checker, and by what their rewards and infos promise."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from layflat.data.types import ACTION_LIMIT_M
from layflat.sim.env import ClothPlaceEnv
from layflat.sim.errors import SimError
from layflat.sim.registration import MAX_EPISODE_STEPS, register_environments
from layflat.tests.sim.helpers import fresh_process_outputs, set_nodes

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


@pytest.mark.parametrize("wrong", [{"cloth": "silk"}, {"render_mode": "human"}, {"disturbance": "earthquake"}])
def test_impossible_environments_are_refused(wrong: dict) -> None:
    with pytest.raises(SimError, match=r"silk|human|earthquake"):
        ClothPlaceEnv("hanger", **wrong)
