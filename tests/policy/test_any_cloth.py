"""Models that lay cloths of any size: taught on one, or several, and acting in the cloth's frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.data.cloth_frame import SIZE_KEYS, ClothFrame
from layflat.policy import model_io, registry
from layflat.policy.base import PolicyError
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.policy.training_set import Demonstrations, recorded_size
from layflat.policy.wrappers.cloth_frame import ClothFramePolicy
from layflat.sim.config import SimConfig
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS
from layflat.tests.fake_environment import FakeEnvironment
from layflat.tests.policy.factories import demonstrations, episode_of, observe

TOWEL, SMALL = (0.35, 0.35), (0.20, 0.25)


def sized(episodes, size, cloth="towel"):
    return [replace(e, cloth=cloth, sim_config=dict(zip(SIZE_KEYS, size, strict=True))) for e in episodes]


def shrunk(episode, frame):
    """Return what a demonstrator would have done with another cloth: the same in its frame."""

    def seen(o):
        scale = 1 / frame.slopes(np.array([0.0, 0.0, 0.0]))
        corners = (o.corner_positions - [0, 0, 0.004]) * scale + [0, 0, 0.004]
        return replace(o, corner_positions=corners, holder_position=corners.mean(axis=0))

    observations = [seen(o) for o in episode.observations()]
    robot = episode.robot
    actions = [
        step.action / robot.pack(frame.slopes(robot.points(o)))
        for step, o in zip(episode.steps, observations, strict=False)
    ]
    made = episode_of(observations[:-1], np.array(actions), robot=robot, seed=episode.seed)
    return replace(made, final_observation=observations[-1])


@pytest.mark.parametrize("robot", ROBOT_SPECS)
@pytest.mark.parametrize("name", ["nearest", "gmr", "dmp"])
def test_the_same_motion_with_a_small_cloth_teaches_the_same_model(name, robot):
    low = [replace(e, steps=e.steps[len(e.steps) // 3 :]) for e in demonstrations(robot)]  # below the cloth's length
    frame = ClothFrame(length_m=SMALL[0], width_m=SMALL[1])
    towel = registry.train(name, sized(low, TOWEL))
    small = registry.train(name, sized([shrunk(e, frame) for e in low], SMALL, "handkerchief"))
    assert (towel.layout.frame, small.cloths) == ("cloth", (("handkerchief", *SMALL),))
    for array, other in zip(towel.arrays().values(), small.arrays().values(), strict=True):
        np.testing.assert_allclose(array, other, atol=1e-6)


def test_the_towels_model_is_that_of_the_thesis_to_the_bit():
    cloth, world = (registry.train("nearest", sized(demonstrations(HANGER), TOWEL), frame=f) for f in (None, "world"))
    assert (cloth.layout.frame, world.layout.frame) == ("cloth", "world")
    for array, other in zip(cloth.arrays().values(), world.arrays().values(), strict=True):
        np.testing.assert_array_equal(array, other)


def test_sessions_of_several_cloths_are_one_set_where_their_sizes_are_known(tmp_path):
    first, other, third = demonstrations(HANGER)
    parts = [Demonstrations.from_episodes(sized([first, other], TOWEL))]
    parts.append(Demonstrations.from_episodes(sized([third], SMALL, "handkerchief")))
    joined = Demonstrations.joined(parts)
    assert joined.cloths == ("towel", "towel", "handkerchief")
    model = registry.train("nearest", joined)
    model_io.save(model, tmp_path / "m.npz")
    again = model_io.load(tmp_path / "m.npz")
    assert again.cloths == model.cloths == (("towel", *TOWEL), ("handkerchief", *SMALL))
    assert (again.layout, again.demonstrations) == (model.layout, 3)
    with pytest.raises(PolicyError, match="mix the cloths handkerchief and towel"):
        registry.train("nearest", joined, frame="world")
    with pytest.raises(PolicyError, match="mix the cloths towel and napkin"):
        Demonstrations.joined([parts[0], Demonstrations.from_episodes([replace(third, cloth="napkin")])])


def test_an_episode_says_how_large_its_cloth_is():
    env = FakeEnvironment(SimConfig(robot="hanger", cloth="bandana"))
    env.reset(0)
    episode = rollout(env, PolicySpec(builtin="hold"), seed=0, max_steps=2)
    assert recorded_size(episode.cloth, episode.sim_config) == ClothFrame(length_m=0.5, width_m=0.5)


def test_without_sizes_a_model_has_the_worlds_frame_and_asking_for_the_cloths_says_so():
    assert registry.train("nearest", demonstrations(HANGER)).layout.frame == "world"
    with pytest.raises(PolicyError, match=r"size of cloth towel is not known; train with --frame world"):
        registry.train("nearest", demonstrations(HANGER), frame="cloth")


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_policy_does_the_same_with_every_cloth_in_its_frame(robot):
    model = registry.train("nearest", sized(demonstrations(robot), TOWEL))
    frame = ClothFrame(length_m=SMALL[0], width_m=SMALL[1])
    plain, framed = registry.from_model(model), ClothFramePolicy(registry.from_model(model), frame)
    for policy in (plain, framed):
        policy.reset(0)
    for z in (0.19, 0.1, 0.01):
        seen = observe(0.1, z, y=SMALL[1] / 2, contact=1 - z)
        wanted = plain.act(frame.observation(seen)).action
        slopes = robot.pack(frame.slopes(robot.points(seen)))
        np.testing.assert_allclose(framed.act(seen).action, wanted / slopes, atol=1e-15)


@pytest.mark.parametrize(("cloth", "framed"), [("towel", False), ("napkin", True), ("bandana", True)])
def test_models_and_built_in_policies_follow_the_cloth_of_the_environment(cloth, framed):
    env = FakeEnvironment(SimConfig(robot="pickers", cloth=cloth))
    env.reset(0)
    assert isinstance(PolicySpec.parse("drag-rule").make(env), ClothFramePolicy) == framed
    for frame in ("cloth", "world"):
        model = registry.train("nearest", sized(demonstrations(PICKERS), TOWEL), frame=frame)
        made = PolicySpec(model=model, wrappers=("recovery", "steady")).make(env)
        assert isinstance(made, ClothFramePolicy) == (framed and frame == "cloth")
