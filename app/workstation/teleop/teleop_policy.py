"""A person as a policy."""

from __future__ import annotations

from collections.abc import Callable

from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import Observation
from layflat.policy.base import Decision


class TeleopPolicy:
    """Decides what the newest reading says; a person stops an episode by a control, never by a decision.

    ``read`` gives the newest reading and does not wait; ``name`` is the source's, as records have it.
    """

    def __init__(self, robot: RobotSpec, name: str, read: Callable[[], TeleopInput]) -> None:
        self.robot: RobotSpec = robot
        self.name = name
        self._read = read

    def reset(self, seed: int) -> None:
        """A person remembers what they like."""

    def act(self, observation: Observation) -> Decision:
        reading = self._read()
        if reading.hand is not None:
            return Decision(action=reading.action, hand=reading.hand, reason="led by hand")
        return Decision(action=reading.action, reason="moved by hand" if reading.moving else "held still")
