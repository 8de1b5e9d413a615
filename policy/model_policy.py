"""Rolls a trained field out: each step, the mean of what it predicts, until the output has faded."""

from __future__ import annotations

import numpy as np

from layflat.data.types import Observation
from layflat.policy.base import Decision
from layflat.policy.scripted.baselines import X_LIMIT_M
from layflat.policy.stopping import AnyOf, BelowThreshold, NoContactGain, StopRule, XLimit
from layflat.policy.trained_model import RegressionModel, TrainedModel

NO_GAIN_STEPS = 10
NO_GAIN_FROM_CONTACT = 0.8


def default_guard() -> StopRule:
    """Against running away: a fold keeps the contact portion low, so that a policy would drag on to the edge.

    Without gain counts only from 80 % contact on: before that a part of the cloth is still in the air.
    """
    return AnyOf(XLimit(X_LIMIT_M), NoContactGain(n_steps=NO_GAIN_STEPS, from_contact=NO_GAIN_FROM_CONTACT))


def stop_rule(model: TrainedModel, guard: StopRule | None) -> StopRule:
    """When a trained model has finished: its output has faded, or the guard (None: the default one) says so."""
    faded = BelowThreshold(threshold_m=model.stop_threshold_m, n_steps=model.stop_steps)
    return AnyOf(faded, default_guard() if guard is None else guard)


class ModelPolicy:
    """Gaussian processes, or another field, in the loop; thesis, chapter 4-2-3.

    Stops with ``threshold`` when the norm of the output has stayed below the model's threshold for the model's number
    of steps, or when its guard says so. ``guard=AnyOf()`` is the thesis's method, which has none.
    """

    def __init__(self, model: RegressionModel, *, guard: StopRule | None = None) -> None:
        self.model = model
        self.name = model.policy
        self.robot = model.layout.robot
        self._stop = stop_rule(model, guard)

    def reset(self, seed: int) -> None:
        self._stop.reset()

    def resume(self) -> None:
        self._stop.reset()

    def act(self, observation: Observation) -> Decision:
        means, stds = self.model.predict(self.model.layout.vector(observation)[np.newaxis])
        limit = self.model.action_limit_m
        wanted = np.clip(means[0], -limit, limit)
        stop = self._stop.update(observation, wanted)
        # Below the threshold the robot stands still (chapter 4-3-3): eight steps of creep would drag wrinkles out too.
        action = wanted if np.linalg.norm(wanted) >= self.model.stop_threshold_m else np.zeros_like(wanted)
        if stop is not None:
            return Decision(action=np.zeros_like(action), std=stds[0], stop=stop.by, reason=stop.reason)
        return Decision(action=action, std=stds[0], reason=f"output {1000 * np.linalg.norm(wanted):.1f} mm")
