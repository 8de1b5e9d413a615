"""Wrinkle removal by WORD (chapter 3-2-2, Algorithm 2), and the two controllers that the thesis compares it with.

All three move the pickers in the table's plane, by the same step, from the same starts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, Policy, PolicyError
from layflat.policy.scripted.baselines import X_LIMIT_M, DragPolicy, RandomPolicy
from layflat.policy.stopping import AnyOf, ContactReached, StopRule, XLimit

STEP_M = 0.010
"""What a picker moves in one step."""
FLAT_CONTACT = 0.99
FLAT_STEPS = 6
"""Algorithm 2 goes on while contact is below 100 %, of which the camera's noise takes some tenths of a percent. Here it
ends when the camera has said 99 % for six steps: a taut cloth seemed to be full while a wrinkle was left."""
STEPS = 60
"""Steps after which an episode of any controller ends."""


class WordFlatten:
    """Algorithm 2: while the contact portion is below 100 %, move the picker on WORD's side along WORD.

    W = (W_x, W_y) is ``observation.word``, whichever descriptor it comes from. W_y > 0: picker 1 (at +y) moves by
    ``step_m`` in W's direction, else picker 2 does. Where there is no direction (W = 0, wrinkles too faint for the
    camera) the thesis says nothing; both pickers then move along +x, the direction in which the cloth is to be pulled.
    """

    name = "word"

    def __init__(self, robot: RobotSpec, *, step_m: float = STEP_M) -> None:
        if not 0 < step_m <= ACTION_LIMIT_M:
            raise PolicyError(f"step_m is {step_m}; it must be above 0 and at most {ACTION_LIMIT_M}")
        self.robot = robot
        self._step_m = step_m
        self._stop = _flat_or_out_of_view()

    def reset(self, seed: int) -> None:
        self._stop.reset()

    def resume(self) -> None:
        self._stop.reset()

    def act(self, observation: Observation) -> Decision:
        action = np.zeros((2, 3))
        stop = self._stop.update(observation, action.ravel())
        if stop is not None:
            return Decision(action=action.ravel(), stop=stop.by, reason=stop.reason)
        word = observation.word
        if not word.any():
            return Decision(
                action=self.robot.pack([self._step_m, 0.0, 0.0]), reason="no direction: both pickers along +x"
            )
        picker = 0 if word[1] > 0 else 1
        action[picker, :2] = self._step_m * word
        return Decision(action=action.ravel(), reason=f"picker {picker + 1} along WORD")


def _flat_or_out_of_view() -> StopRule:
    return AnyOf(ContactReached(FLAT_CONTACT, n_steps=FLAT_STEPS), XLimit(X_LIMIT_M))


def _stretch_right(robot: RobotSpec) -> Policy:
    return DragPolicy(robot, name="stretch-right", stop=_flat_or_out_of_view(), speed_m=STEP_M)


CONTROLLERS: Mapping[str, Callable[[RobotSpec], Policy]] = {
    "word": WordFlatten,
    "stretch-right": _stretch_right,
    "random": lambda robot: RandomPolicy(robot, limit_m=STEP_M, planar=True),
}
"""The proposed method and the baselines of Figures 3-6, 3-7 and 3-8."""


def controller(name: str, robot: RobotSpec) -> Policy:
    """A controller of wrinkle removal by name; PolicyError lists the known ones."""
    if name not in CONTROLLERS:
        raise PolicyError(f"controller {name!r} is unknown; it must be one of {', '.join(CONTROLLERS)}")
    return CONTROLLERS[name](robot)
