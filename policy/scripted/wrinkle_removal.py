"""Wrinkle removal by WORD (chapter 3-2-2, Algorithm 2), and the two controllers that the thesis compares it with.

All three move the robot's points in the table's plane, by the same step, from the same starts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, Policy, PolicyError
from layflat.policy.scripted.baselines import DragPolicy, RandomPolicy
from layflat.policy.stopping import AnyOf, RuleStoppedPolicy, StopRule, contact_reached, positive, x_limit

STEP_M = 0.010
"""Displacement of a picker in one step."""
FLAT_CONTACT, FLAT_STEPS = 0.99, 6
"""Algorithm 2 ends at 100 % contact, of which noise takes some tenths of a percent; here 99 % for six steps, since
a taut cloth seemed to be flat while a wrinkle was left."""


class WordFlatten(RuleStoppedPolicy):
    """Algorithm 2: while the contact portion is below 100 %, move the picker on WORD's side along WORD.

    With W = ``observation.word``, from any descriptor: if W_y > 0, picker 1 (at +y) moves by ``step_m`` along W,
    else picker 2. Where there is no direction (W = 0), which the thesis leaves open, both move along +x.
    """

    def __init__(self, robot: RobotSpec, *, step_m: float = STEP_M) -> None:
        if robot.n_points != 2:
            raise PolicyError(f"controller word moves two pickers on their own; robot {robot} cannot")
        super().__init__("word", robot, _flat_or_out_of_view())
        self._step_m = positive("step_m", step_m, ACTION_LIMIT_M)

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        word = observation.word
        if word.any():
            picker = 0 if word[1] > 0 else 1
            moves = np.zeros((2, 3))
            moves[picker, :2] = self._step_m * word
            action, reason = self.robot.pack(moves), f"picker {picker + 1} along WORD"
        else:
            action = self.robot.pack([self._step_m, 0.0, 0.0])
            reason = "no direction: both pickers along +x"
        return self._decide(observation, action, reason)


def _flat_or_out_of_view() -> StopRule:
    return AnyOf(contact_reached(FLAT_CONTACT, n_steps=FLAT_STEPS), x_limit())


CONTROLLERS: Mapping[str, Callable[[RobotSpec], Policy]] = {
    "word": WordFlatten,
    "stretch-right": lambda robot: DragPolicy(robot, name="stretch-right", stop=_flat_or_out_of_view(), speed_m=STEP_M),
    "random": lambda robot: RandomPolicy(robot, limit_m=STEP_M, planar=True),
}
"""The proposed method and the baselines of Figures 3-6, 3-7 and 3-8."""


def controller(name: str, robot: RobotSpec) -> Policy:
    """Make a controller of wrinkle removal by name; PolicyError lists the known names."""
    if name not in CONTROLLERS:
        raise PolicyError(f"controller {name!r} is unknown; it must be one of {', '.join(CONTROLLERS)}")
    return CONTROLLERS[name](robot)
