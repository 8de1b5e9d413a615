"""ReplayPolicy: repeats the actions of a recorded episode."""

from __future__ import annotations

from layflat.data.types import Episode, Observation
from layflat.policy.base import Decision


class ReplayPolicy:
    """Repeats the actions of an episode in their order, without regard to the observations, and then stops.

    Steps of the phase ``disturb`` are left out, because no policy decides them.
    """

    def __init__(self, episode: Episode) -> None:
        self.name, self.robot = episode.source, episode.robot
        self._steps = [step for step in episode.steps if step.phase != "disturb"]
        self._next = 0

    def reset(self, seed: int) -> None:
        """Start with the first action again."""
        self._next = 0

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        if self._next >= len(self._steps):
            return Decision(action=self.robot.zeros(), stop="step_limit", reason="the recording is over")
        self._next += 1
        step = self._steps[self._next - 1]
        return Decision(action=step.action, hand=step.hand_m, reason="as recorded")
