"""Policies without learning, for comparison."""

from __future__ import annotations

import numpy as np

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision
from layflat.policy.stopping import (
    AnyOf,
    NoContactGain,
    RuleStoppedPolicy,
    StopRule,
    contact_reached,
    positive,
    x_limit,
)

DRAG_M = 0.005
"""Drag along +x in one step; well inside the 3..10 mm that the scripted demonstrator uses."""
FLAT_CONTACT = 0.985
"""Contact portion above which no wrinkle is left to drag out."""


class ZeroPolicy:
    """Never moves and never stops."""

    name = "hold"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot

    def reset(self, seed: int) -> None:
        """Do nothing: the policy has no state."""

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        return Decision(action=self.robot.zeros(), reason="holding")


class RandomPolicy:
    """Draws each axis uniformly from +-``limit_m`` in each step and never stops; ``planar`` keeps the height."""

    name = "random"

    def __init__(self, robot: RobotSpec, *, limit_m: float = ACTION_LIMIT_M, planar: bool = False) -> None:
        self.robot = robot
        self._limit_m = positive("limit_m", limit_m, ACTION_LIMIT_M)
        self._free = [not (planar and axis.axis == 2) for axis in robot.axes]
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        self._rng = np.random.default_rng(seed)

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        action = self._rng.uniform(-self._limit_m, self._limit_m, self.robot.size)
        return Decision(action=action * self._free, reason="random move")


class DragPolicy(RuleStoppedPolicy):
    """Drags along +x at constant speed until its stop rule ends the episode."""

    def __init__(self, robot: RobotSpec, *, name: str, stop: StopRule, speed_m: float = DRAG_M) -> None:
        super().__init__(name, robot, stop)
        self._action = robot.pack([positive("speed_m", speed_m, ACTION_LIMIT_M), 0.0, 0.0])

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        return self._decide(observation, self._action, "dragging +x")


def stretch_right(robot: RobotSpec) -> DragPolicy:
    """Drag along +x to the end of the view, without regard to the cloth: the thesis's comparator of chapter 3."""
    return DragPolicy(robot, name="stretch-right", stop=x_limit())


def drag_rule(robot: RobotSpec) -> DragPolicy:
    """Drag along +x while the contact portion grows: three lines that repair about as well as a GP in the plane."""
    stop = AnyOf(contact_reached(FLAT_CONTACT), NoContactGain(n_steps=6), x_limit())
    return DragPolicy(robot, name="drag-rule", stop=stop)
