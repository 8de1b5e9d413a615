"""A person as a policy."""

from __future__ import annotations

from collections.abc import Callable

from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import Observation
from layflat.policy.base import Decision


class TeleopPolicy:
    """Policy that acts as the newest input says; a person ends an episode by a command, never by a decision."""

    def __init__(self, robot: RobotSpec, name: str, read: Callable[[], TeleopInput]) -> None:
        """Use ``read``, which returns the newest input without waiting; ``name`` is the device's, for records."""
        self.robot: RobotSpec = robot
        self.name = name
        self._read = read

    def reset(self, seed: int) -> None:
        """Do nothing: a person has no state here."""

    def act(self, observation: Observation) -> Decision:
        """Return the action of the newest input."""
        newest = self._read()
        if newest.hand is not None:
            return Decision(action=newest.action, hand=newest.hand, reason="guided by hand")
        return Decision(action=newest.action, reason="moved by hand" if newest.moving else "held still")
