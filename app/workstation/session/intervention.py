"""A person beside a policy that places: they take the lead when it goes wrong, and hand it back."""

from __future__ import annotations

from typing import Literal, TypeAlias

from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.app.workstation.teleop.teleop_policy import TeleopPolicy
from layflat.policy.base import Policy
from layflat.policy.wrappers.takeover import ControlRequest, MotionTakeoverTrigger, TakeoverPolicy

Change: TypeAlias = Literal["gone", "back"]
"""Of the device."""
YOU = "you"
"""Who leads, in a status: the person, or a policy by its name."""


class InterventionController:
    """Who leads, by what the hands do. A device that is gone leads nobody."""

    def __init__(self, policy: Policy, source: str) -> None:
        """``policy`` has the lead at first; ``source`` names the device, as records have it."""
        self.reading = zero_input(policy.robot)
        """The newest of the device."""
        self.helped = policy.name
        self._grip = MotionTakeoverTrigger(lambda: self.reading.moving)
        self.policy = TakeoverPolicy(policy, TeleopPolicy(policy.robot, source, lambda: self.reading), self._wish)
        """What decides."""

    @property
    def leads(self) -> bool:
        """Whether the person does."""
        return self.policy.human_in_control

    def hear(self, reading: TeleopInput) -> Change | None:
        """Take note of a reading; says whether the device has gone with it, or come."""
        before, self.reading = self.reading.connected, reading
        if before == reading.connected:
            return None
        return "back" if reading.connected else "gone"

    def hand_back(self) -> None:
        """The person has done, and the policy leads from the next step on, unless the hands still move."""
        self._grip.release()

    def told(self) -> str:
        """Who leads, in a sentence."""
        return led_sentence(self.leads, self.helped)

    def _wish(self) -> ControlRequest | None:
        return self._grip() if self.reading.connected else "release"


def led_sentence(person: bool, policy: str) -> str:
    """What is said when the lead changes hands."""
    return f"you have the lead; rest, and {policy} has it again" if person else f"{policy} has the lead again"
