"""InterventionController: a person beside a policy, who takes over when it goes wrong and returns control."""

from __future__ import annotations

from typing import Literal, TypeAlias

from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.app.workstation.teleop.teleop_policy import TeleopPolicy
from layflat.policy.base import Policy
from layflat.policy.wrappers.takeover import ControlRequest, MotionTakeoverTrigger, TakeoverPolicy

DeviceChange: TypeAlias = Literal["disconnected", "reconnected"]
YOU = "you"
"""Controller in a status: the person, or else the policy by its name."""


class InterventionController:
    """Decides who is in control, by the person's input. A disconnected device is never in control."""

    def __init__(self, policy: Policy, source: str) -> None:
        """Start with ``policy`` in control; ``source`` names the device in records."""
        self.teleop = zero_input(policy.robot)
        """Newest input."""
        self.assisted_policy = policy.name
        self._trigger = MotionTakeoverTrigger(lambda: self.teleop.moving)
        self.policy = TakeoverPolicy(policy, TeleopPolicy(policy.robot, source, lambda: self.teleop), self._request)
        """Policy and person together."""

    @property
    def human_in_control(self) -> bool:
        """Whether the person is in control."""
        return self.policy.human_in_control

    def handle_input(self, teleop: TeleopInput) -> DeviceChange | None:
        """Take a new input; return whether the device was disconnected or reconnected with it."""
        before, self.teleop = self.teleop.connected, teleop
        if before == teleop.connected:
            return None
        return "reconnected" if teleop.connected else "disconnected"

    def release_control(self) -> None:
        """Return control to the policy from the next step on, unless the person still moves."""
        self._trigger.release()

    def describe(self) -> str:
        """Return who is in control, as a sentence."""
        return describe_control(self.human_in_control, self.assisted_policy)

    def _request(self) -> ControlRequest | None:
        return self._trigger() if self.teleop.connected else "release"


def describe_control(human: bool, policy: str) -> str:
    """Return the sentence for a change of control."""
    return f"you are in control; stop moving to return control to {policy}" if human else f"{policy} is in control"
