"""ClothFramePolicy: a policy that acts on any cloth as if it were as large as the towel."""

from __future__ import annotations

from dataclasses import replace

from layflat.data.cloth_frame import ClothFrame
from layflat.data.types import Observation
from layflat.policy.base import Decision, Policy, continue_after_disturbance, max_extra_steps


class ClothFramePolicy:
    """Acts as ``policy``, which sees and moves the cloth in its own frame: lengths are shares of the cloth's.

    All lengths that the policy, its stop rules and wrappers hold are those for the towel.
    """

    def __init__(self, policy: Policy, frame: ClothFrame) -> None:
        self.name, self.robot, self.max_extra_steps = policy.name, policy.robot, max_extra_steps(policy)
        self._policy, self._frame = policy, frame

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        self._policy.reset(seed)

    def continue_after_disturbance(self) -> None:
        """Prepare the policy to continue."""
        continue_after_disturbance(self._policy)

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        decision = self._policy.act(self._frame.observation(observation))
        action = self._frame.action_to_world(decision.action, self.robot, observation)
        slopes = self.robot.pack(self._frame.slopes(self.robot.points(observation)))
        return replace(decision, action=action, std=None if decision.std is None else decision.std / slopes)
