"""A policy that knows no care, for what is put around it."""

from __future__ import annotations

from layflat.data.robot import RobotSpec
from layflat.data.types import Observation
from layflat.policy.base import Decision


class Down:
    """Straight down, 1 cm a step."""

    name = "down"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot

    def reset(self, seed: int) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Decision:
        return Decision(action=self.robot.pack([0.0, 0.0, -0.01]), reason="down")
