"""Two policies in a row: the first places the cloth, the second takes over after the disturbance."""

from __future__ import annotations

from layflat.data.types import Observation
from layflat.policy.base import Decision, Policy, PolicyError


class SequentialPolicy:
    """Acts as ``first`` until it is told to go on after a stop, then as ``then``: a comparator for repair alone."""

    def __init__(self, first: Policy, then: Policy, *, name: str) -> None:
        if first.robot != then.robot:
            raise PolicyError(f"{first.name} is for the {first.robot} robot and {then.name} for the {then.robot} robot")
        self.name = name
        self.robot = first.robot
        self._first, self._then = first, then
        self._now = first

    def reset(self, seed: int) -> None:
        self._first.reset(seed)
        self._then.reset(seed)
        self._now = self._first

    def resume(self) -> None:
        self._now = self._then
        self._then.resume()

    def act(self, observation: Observation) -> Decision:
        return self._now.act(observation)
