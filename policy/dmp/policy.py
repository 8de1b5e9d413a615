"""DmpPolicy: rolls out a dynamic movement primitive."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Observation
from layflat.policy.base import Decision
from layflat.policy.dmp.model import DmpModel, trajectory
from layflat.policy.model_policy import model_stop_rule
from layflat.policy.stopping import RuleStoppedPolicy, StopRule


class DmpPolicy(RuleStoppedPolicy):
    """Follows the primitive from the robot's first position to the goal and rests there; it does not see the cloth.

    The actions are the primitive's own steps, so that the robot's lag does not add up. After a disturbance the
    primitive continues; it does not start again.
    """

    def __init__(self, model: DmpModel, *, guard: StopRule | None = None) -> None:
        super().__init__(model.policy, model.layout.robot, model_stop_rule(model, guard))
        self.model = model
        self._trajectory: Iterator[tuple[float, FloatArray]] | None = None

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        super().reset(seed)
        self._trajectory = None

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        model, limit = self.model, self.model.action_limit_m
        if self._trajectory is None:
            self._commanded = model.layout.vector(observation)
            self._trajectory = trajectory(self._commanded, model.goal, model.weights, model.step_u)
        u, position = next(self._trajectory)
        # Later steps make up for what the limit cuts off.
        action = np.clip(position - self._commanded, -limit, limit)
        decision = self._decide(observation, action, f"{100 * min(u, 1.0):.0f} % of the way")
        if decision.stop is None:
            self._commanded = self._commanded + action
        return decision
