"""SequentialPolicy: one policy places the cloth, another continues after the disturbance."""

from __future__ import annotations

from layflat.data.types import Observation
from layflat.policy.base import Decision, Policy, PolicyError, continue_after_disturbance


class SequentialPolicy:
    """Acts as ``first`` until the episode continues after a stop, then as ``then``; compares repairs alone."""

    def __init__(self, first: Policy, then: Policy, *, name: str) -> None:
        if first.robot != then.robot:
            raise PolicyError(f"{first.name} is for robot {first.robot}, but {then.name} is for {then.robot}")
        self.name, self.robot = name, first.robot
        self._first, self._then, self._active = first, then, first

    def reset(self, seed: int) -> None:
        """Start a new episode with the first policy."""
        self._first.reset(seed)
        self._then.reset(seed)
        self._active = self._first

    def continue_after_disturbance(self) -> None:
        """Continue with the second policy."""
        self._active = self._then
        continue_after_disturbance(self._then)

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        return self._active.act(observation)
