"""What was done once, done again: the actions of a recorded episode as a policy."""

from __future__ import annotations

from layflat.data.types import Episode, Observation
from layflat.policy.base import Decision


class ReplayPolicy:
    """The actions of an episode in their order, whatever is seen; stops after the last.

    The steps of a disturbance are not among them: nobody decides there.
    """

    def __init__(self, episode: Episode) -> None:
        self.name = episode.source
        self.robot = episode.robot
        self._steps = [step for step in episode.steps if step.phase != "disturb"]
        self._next = 0

    def reset(self, seed: int) -> None:
        self._next = 0

    def resume(self) -> None:
        """The recording goes on after its stop by itself."""

    def act(self, observation: Observation) -> Decision:
        if self._next >= len(self._steps):
            return Decision(action=self.robot.zeros(), stop="step_limit", reason="the recording is over")
        self._next += 1
        step = self._steps[self._next - 1]
        return Decision(action=step.action, hand=step.hand_m, reason="as recorded")
