"""Environment: anything in which a policy can act, such as a simulation, a real robot or a recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.environment_spec import EnvironmentSpec
from layflat.data.types import FLAT_AREA, DisturbanceRecord, GroundTruth, Observation


class Environment(Protocol):
    """A world with a robot and a cloth, which `layflat.policy.runner` steps; nothing happens between two calls.

    Every environment implements `spec`, `reset`, `observe`, `step` and `close`. A class that inherits from this one
    gets the others: no ground truth, no disturbances and no hand.
    """

    @property
    def spec(self) -> EnvironmentSpec:
        """Properties that are the same in every episode."""
        ...

    def reset(self, seed: int) -> None:
        """Start an episode; the same seed gives the same start."""
        ...

    def observe(self) -> Observation:
        """Return what a policy may see now."""
        ...

    def step(self, action: FloatArray) -> None:
        """Move the robot by ``action``, (A,) m in the order of its axes, in one control step."""
        ...

    def close(self) -> None:
        """Release everything that the environment holds; may be called twice."""
        ...

    def ground_truth(self) -> GroundTruth | None:
        """Return what only a simulator knows, or None."""
        return None

    def success(self) -> bool:
        """Whether the cloth lies flat: by the mesh, or by the camera's contact portion where there is no mesh."""
        truth = self.ground_truth()
        return (self.observe().contact_portion if truth is None else truth.flat_area) > FLAT_AREA

    def divergence_reason(self) -> str | None:
        """Return why the simulation has diverged, or None; called once a step."""
        return None

    def disturb(self, disturbance: Any, repeat: int = 0) -> DisturbanceRecord | None:
        """Start a disturbance, which acts in the following steps; return what was drawn, None where it does nothing.

        Parameters
        ----------
        disturbance
            A name, a description that the environment understands, or a `DisturbanceRecord` to repeat exactly.
        repeat
            Number of disturbances of this episode before it, so that each is drawn independently.
        """
        raise NotImplementedError(f"{type(self).__name__} has no disturbances")

    @property
    def disturbed(self) -> bool:
        """Whether a disturbance still acts, or the cloth has not come to rest after it."""
        return False

    @property
    def start(self) -> Mapping[str, float]:
        """Random values of the start, by name."""
        return {}

    def joint_angles(self) -> FloatArray:
        """Return the joint angles of the arm, (J,) rad; empty where there is no arm."""
        return np.zeros(0)

    def force_n(self) -> FloatArray:
        """Return the mean force of disturbances and drags on the cloth in the last step, (3,) N, world."""
        return np.zeros(3)

    def drag(self, node: int, target_m: FloatArray) -> None:
        """Pull the cloth's ``node`` towards ``target_m``, (3,) m, world, with a bounded force, until `release`."""
        raise NotImplementedError(f"{type(self).__name__} has no cloth nodes to pull at")

    def release(self) -> None:
        """End the drag, if there is one."""

    def guide(self, hand_m: FloatArray | None) -> FloatArray:
        """Let a hand at ``hand_m`` guide the robot for one step; return the resulting action, (A,) m."""
        raise NotImplementedError(f"{type(self).__name__} cannot be guided by hand")
