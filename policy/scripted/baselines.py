"""Policies without learning: comparators and stand-ins, each an ordinary policy."""

from __future__ import annotations

import numpy as np

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, PolicyError
from layflat.policy.stopping import AnyOf, ContactReached, NoContactGain, StopRule, XLimit

X_LIMIT_M = 0.75
"""World x at which the camera's view ends."""
DRAG_M = 0.005
"""A drag along +x in one step; well inside the 3..10 mm that the scripted demonstrator uses."""
FLAT_CONTACT = 0.985
"""Contact portion above which there is nothing left to pull out."""


class ZeroPolicy:
    """Does nothing, for ever."""

    name = "hold"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot

    def reset(self, seed: int) -> None:
        """Nothing to forget."""

    def resume(self) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Decision:
        return Decision(action=self.robot.zeros(), reason="holding")


class RandomPolicy:
    """Each axis uniform in +-``limit_m``, drawn anew in each step; never stops. ``planar``: nothing moves along z."""

    name = "random"

    def __init__(self, robot: RobotSpec, *, limit_m: float = ACTION_LIMIT_M, planar: bool = False) -> None:
        if not 0 < limit_m <= ACTION_LIMIT_M:
            raise PolicyError(f"limit_m is {limit_m}; it must be above 0 and at most {ACTION_LIMIT_M}")
        self.robot = robot
        self._limit_m = limit_m
        self._free = [not (planar and axis.axis == 2) for axis in robot.axes]
        self._rng = np.random.default_rng(0)

    def reset(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def resume(self) -> None:
        """Nothing to forget; the draws go on."""

    def act(self, observation: Observation) -> Decision:
        action = self._rng.uniform(-self._limit_m, self._limit_m, self.robot.size)
        return Decision(action=action * self._free, reason="random move")


class DragPolicy:
    """Drags along +x at constant speed until its rule stops it."""

    def __init__(self, robot: RobotSpec, *, name: str, stop: StopRule, speed_m: float = DRAG_M) -> None:
        if not 0 < speed_m <= ACTION_LIMIT_M:
            raise PolicyError(f"speed_m is {speed_m}; it must be above 0 and at most {ACTION_LIMIT_M}")
        self.name = name
        self.robot = robot
        self._stop = stop
        self._action = robot.pack([speed_m, 0.0, 0.0])

    def reset(self, seed: int) -> None:
        self._stop.reset()

    def resume(self) -> None:
        self._stop.reset()

    def act(self, observation: Observation) -> Decision:
        stop = self._stop.update(observation, self._action)
        if stop is not None:
            return Decision(action=np.zeros_like(self._action), stop=stop.by, reason=stop.reason)
        return Decision(action=self._action, reason="dragging +x")


def stretch_right(robot: RobotSpec) -> DragPolicy:
    """Pulls along +x whatever the cloth does, to the end of the view: the thesis's comparator of chapter 3."""
    return DragPolicy(robot, name="stretch-right", stop=XLimit(X_LIMIT_M))


def drag_rule(robot: RobotSpec) -> DragPolicy:
    """Three lines that repair about as well as a GP in the plane: drag +x while contact grows, then stop."""
    stop = AnyOf(ContactReached(FLAT_CONTACT), NoContactGain(n_steps=6), XLimit(X_LIMIT_M))
    return DragPolicy(robot, name="drag-rule", stop=stop)
