"""Environment: anything in which a policy can act, such as a simulation, a real robot or a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import STEP_S, DisturbanceRecord, GroundTruth, Observation


@dataclass(frozen=True, kw_only=True)
class ClothShape:
    """The size of a cloth as it lies flat, and its mesh."""

    length_m: float
    """From the free edge to the held edge."""
    width_m: float
    """Along the held edge."""
    held_width_m: float
    """Distance at which a robot holds the two corners."""
    rows: int
    columns: int
    """Nodes of the ground truth: ``rows`` x ``columns``, the free edge first."""


@dataclass(frozen=True, kw_only=True)
class EnvironmentSpec:
    """What policies and recorders need to know of an environment before it starts."""

    robot: RobotSpec
    cloth: str
    """Name of the cloth."""
    task: str = "place"
    physics: str = "bullet"
    descriptor: str = "word"
    """What the observations' WORD comes from."""
    step_s: float = STEP_S
    """Duration of a control step, s."""
    cloth_shape: ClothShape | None = None
    """None where nobody has measured the cloth."""
    config: Mapping[str, str | float | bool] = field(default_factory=dict)
    """Further settings, by name, that make the same environment again."""


@runtime_checkable
class Environment(Protocol):
    """What `layflat.policy.rollout` drives. Simulated time is its clock: nothing happens between two calls.

    An environment is made once and started by `reset`, as often as wished unless it says otherwise.
    """

    @property
    def spec(self) -> EnvironmentSpec:
        """What does not change from episode to episode."""

    def reset(self, seed: int) -> None:
        """Start an episode: the same seed gives the same start."""

    def observe(self) -> Observation:
        """Return what a policy may see now."""

    def ground_truth(self) -> GroundTruth | None:
        """Return what only a simulator knows, or None where there is no simulator."""

    def step(self, action: FloatArray) -> None:
        """Move the robot by ``action``, (A,) m in the order of its axes, in one control step."""

    def disturb(self, disturbance: Any, repeat: int = 0) -> DisturbanceRecord | None:
        """Begin a disturbance, which acts in the following steps; None where it does nothing.

        Parameters
        ----------
        disturbance
            A name, a description that the environment understands, or a `DisturbanceRecord` to be repeated exactly.
        repeat
            Number of disturbances of this episode before it, so that each is drawn on its own.
        """

    def close(self) -> None:
        """Give back what the environment holds; may be called twice."""


class EpisodeEvents:
    """Defaults for what an environment need not have; `Environment` implementations inherit or override them."""

    @property
    def disturbed(self) -> bool:
        """Whether a disturbance still acts, or the cloth has not come to rest after it."""
        return False

    @property
    def start(self) -> Mapping[str, float]:
        """What was random about the start, by name."""
        return {}

    def force_n(self) -> FloatArray:
        """Return the mean force of disturbances and drags on the cloth in the last step, (3,) N, world."""
        return np.zeros(3)

    def initial_joints(self) -> FloatArray:
        """Return the joint angles of the arm, (J,) rad; empty where there is none."""
        return np.zeros(0)

    def divergence_reason(self) -> str | None:
        """Say why the simulation has diverged, or None."""
        return None

    def drag(self, node: int, target_m: FloatArray) -> None:
        """Draw the cloth's ``node`` to ``target_m`` (3,) m, world, by a hand of bounded force."""
        raise NotImplementedError(f"{type(self).__name__} has no mesh to drag at")

    def release(self) -> None:
        """End the drag, if there is one."""

    def guide(self, hand_m: FloatArray | None) -> FloatArray:
        """Let a hand at ``hand_m`` guide the robot for one step; return the action (A,) that came of it."""
        raise NotImplementedError(f"{type(self).__name__} cannot be guided by hand")
