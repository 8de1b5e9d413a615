"""ModelPolicy: rolls out a trained regression model until its output has faded."""

from __future__ import annotations

import numpy as np

from layflat.data.types import Observation
from layflat.policy.base import Decision
from layflat.policy.stopping import AnyOf, NoContactGain, RuleStoppedPolicy, StopRule, below_threshold, x_limit
from layflat.policy.trained_model import RegressionModel, TrainedModel

NO_GAIN_STEPS, NO_GAIN_FROM_CONTACT = 10, 0.8
"""Steps, and contact portion from which a missing gain counts; before, a part of the cloth is still in the air."""


def model_stop_rule(model: TrainedModel, guard: StopRule | None) -> StopRule:
    """Return the rule that ends a model's policy: its output has faded, or it runs away by the guard.

    The default guard ends a drag that gains nothing: a fold keeps the contact portion low, so that a policy would drag
    on to the edge of the table.
    """
    if guard is None:
        guard = AnyOf(x_limit(), NoContactGain(n_steps=NO_GAIN_STEPS, from_contact=NO_GAIN_FROM_CONTACT))
    return AnyOf(below_threshold(model.stop_threshold_m, n_steps=model.stop_steps), guard)


class ModelPolicy(RuleStoppedPolicy):
    """Policy of a regression model (thesis, chapter 4-2-3): each action is the mean of the model's prediction.

    Stops with ``threshold`` when the norm of the output stays below the model's threshold for the model's number of
    steps, or when the guard stops it. The thesis's method has no guard: ``guard=AnyOf()``.
    """

    def __init__(self, model: RegressionModel, *, guard: StopRule | None = None) -> None:
        super().__init__(model.policy, model.layout.robot, model_stop_rule(model, guard))
        self.model = model

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        means, stds = self.model.predict(self.model.layout.vector(observation)[np.newaxis])
        limit = self.model.action_limit_m
        output = np.clip(means[0], -limit, limit)
        norm = np.linalg.norm(output)
        # Below the threshold the robot stands still (chapter 4-3-3): eight steps of creep would drag wrinkles out too.
        action = output if norm >= self.model.stop_threshold_m else np.zeros_like(output)
        return self._decide(observation, action, f"output {1000 * norm:.1f} mm", std=stds[0], output=output)
