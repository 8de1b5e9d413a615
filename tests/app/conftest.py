"""Made-up episodes with the shape of real ones: placing, a disturbance, and a repair or none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from layflat.data.arrays import FloatArray
from layflat.data.types import Episode, GroundTruth, Observation, Step
from layflat.policy.features import FeatureLayout, input_set
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.robots.registry import robot_spec
from layflat.tests.app.program import start_program

__all__ = ["start_program"]

PLACE, DISTURB, REPAIR = 60, 10, 25
EpisodeMaker = Callable[..., Episode]


def _picture(share: float, step_index: int) -> np.ndarray:
    """A grey table with a striped red cloth, of which ``share`` lies."""
    rgb = np.full((120, 160, 3), 215, np.uint8)
    length = int(20 + 110 * min(max(share, 0.0), 1.0))
    stripes = (30 * np.sin(np.arange(length) / 4 + step_index)).astype(int)
    rgb[30:95, 15 : 15 + length] = (190, 40, 50)
    rgb[30:95, 15 : 15 + length, 0] = np.clip(190 + stripes, 0, 255)
    return rgb


def _contact(step_index: int, gain: float, noise: FloatArray) -> float:
    """Rises while placing, falls by 14 points while disturbed, rises by ``gain`` while repaired."""
    if step_index <= PLACE:
        return max(float(0.97 / (1 + np.exp(-(step_index - 38) / 5)) + noise[step_index]), 0.0)
    if step_index <= PLACE + DISTURB:
        return float(0.96 - 0.14 * (step_index - PLACE) / DISTURB)
    return float(0.82 + gain * (step_index - PLACE - DISTURB) / REPAIR)


def _fake_episode(
    *,
    robot: str = "hanger",
    source: str = "gp-word",
    seed: int = 0,
    disturbed: bool = True,
    gain: float = 0.08,
    images: bool = False,
    **changes: Any,
) -> Episode:
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, 0.004, PLACE + 1)
    wave = 0.02 * rng.normal()
    n_steps = PLACE + (DISTURB + REPAIR if disturbed else 0)

    def observation(step_index: int) -> Observation:
        progress = min(step_index / PLACE, 1.0)
        late = gain / 2 * max(step_index - PLACE - DISTURB, 0) / REPAIR
        place = np.array(
            [-0.15 + 0.45 * progress**2 + late, 0.0, 0.02 + 0.4 * (1 - progress) ** 2 + wave * (1 - progress)]
        )
        contact = _contact(step_index, gain, noise)
        return Observation(
            time_s=step_index * 0.1,
            corner_positions=place + np.array([[0, 0.175, 0], [0, -0.175, 0]]),
            holder_position=place,
            word=np.array([1.0, 0.0]) if contact < 0.9 else np.zeros(2),
            word_strength=0.1,
            contact_portion=contact,
            rgb=_picture(contact, step_index) if images else None,
        )

    def ground_truth(step_index: int) -> GroundTruth:
        contact = _contact(step_index, gain, noise)
        return GroundTruth(
            nodes=np.zeros((4, 3)), contact_portion_true=min(contact, 1.0), flat_area=min(contact + 0.01, 1.0)
        )

    def step(step_index: int) -> Step:
        here, after = observation(step_index), observation(step_index + 1)
        move = np.vstack([after.corner_positions - here.corner_positions])
        action = robot_spec(robot).pack(move[0] if robot_spec(robot).n_points == 1 else move)
        phase = "place" if step_index < PLACE else "disturb" if step_index < PLACE + DISTURB else "repair"
        return Step(observation=here, ground_truth=ground_truth(step_index), action=action, phase=phase)

    values: dict[str, Any] = {
        "robot": robot_spec(robot),
        "cloth": "towel",
        "seed": seed,
        "source": source,
        "steps": tuple(step(step_index) for step_index in range(n_steps)),
        "final_observation": observation(n_steps),
        "final_ground_truth": ground_truth(n_steps),
        "stopped_by": "threshold",
        "outcome": "success",
        "disturbance": "push" if disturbed else "none",
        "wall_s": 4.5,
    }
    return Episode(**{**values, **changes})


class NearestModel:
    """Predicts the action of the nearest demonstrated step, the less surely the farther it is."""

    def __init__(self, layout: FeatureLayout, episodes: list[Episode]) -> None:
        self.layout = layout
        self._inputs = np.concatenate([layout.matrix(episode.steps) for episode in episodes])
        self._actions = np.concatenate([[step.action for step in episode.steps] for episode in episodes])

    def predict(self, inputs: FloatArray, /) -> tuple[FloatArray, FloatArray]:
        distance = np.linalg.norm(np.asarray(inputs)[:, None] - self._inputs[None], axis=2)
        near = distance.argmin(axis=1)
        fade = np.exp(-((distance.min(axis=1) / 0.1) ** 2))[:, None]
        outputs = self.layout.robot.size
        return fade * self._actions[near], np.repeat(0.001 + 0.008 * (1 - fade), outputs, axis=1)


@pytest.fixture(scope="session")
def make_episode() -> EpisodeMaker:
    return _fake_episode


@pytest.fixture(scope="session")
def make_model() -> Callable[[str, str, list[Episode]], NearestModel]:
    return lambda robot, inputs, episodes: NearestModel(input_set(robot_spec(robot), inputs), episodes)


@pytest.fixture(scope="session")
def lying() -> Callable[..., Episode]:
    """``lying(episode, steps=6)``: the episode's first steps with the nodes of a towel that slides along the table."""

    def made(episode: Episode, n_steps: int = 6) -> Episode:
        spec = cloth_spec(episode.cloth)

        def ground_truth(step_index: int) -> GroundTruth:
            return GroundTruth(nodes=spec.flat_nodes(x_m=0.02 * step_index), contact_portion_true=1.0, flat_area=1.0)

        steps = tuple(
            replace(step, ground_truth=ground_truth(step_index))
            for step_index, step in enumerate(episode.steps[:n_steps])
        )
        after = episode.steps[n_steps].observation
        return replace(episode, steps=steps, final_observation=after, final_ground_truth=ground_truth(n_steps))

    return made
