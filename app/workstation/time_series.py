"""TimeSeries: contact portion and WORD of one episode over time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.data.types import Episode


@dataclass
class TimeSeries:
    """Values of one episode, step by step."""

    episode: int = -1
    time_s: list[float] = field(default_factory=list)
    contact: list[float] = field(default_factory=list)
    angle_deg: list[float] = field(default_factory=list)
    """Direction of WORD, -90..90; NaN where there is none."""
    phase: list[str] = field(default_factory=list)
    human: list[bool] = field(default_factory=list)
    """Whether a person, not the policy, decided the step before."""

    def add(self, frame: SimulationFrame) -> None:
        """Append a frame; another episode, or one earlier in time, starts again."""
        if frame.episode != self.episode or (self.time_s and frame.sim_s < self.time_s[-1] - 1e-9):
            self.__init__(frame.episode)  # type: ignore[misc]
        if self.time_s and frame.sim_s <= self.time_s[-1] + 1e-9:
            return
        self.time_s.append(frame.sim_s)
        self.contact.append(frame.contact)
        self.angle_deg.append(_angle(frame.word))
        self.phase.append(frame.phase)
        self.human.append(frame.human_in_control)

    @staticmethod
    def of(episode: Episode, number: int) -> TimeSeries:
        """Return the values of a recorded episode."""
        observations = episode.observations()
        phases = [step.phase for step in episode.steps]
        return TimeSeries(
            episode=number,
            time_s=[one.time_s for one in observations],
            contact=[one.contact_portion for one in observations],
            angle_deg=[_angle(one.word) for one in observations],
            phase=[*phases, phases[-1] if phases else "place"],
            human=[False, *(step.intervention for step in episode.steps)],
        )


def _angle(word: NDArray[np.float64]) -> float:
    return math.degrees(math.atan2(word[1], word[0])) if np.any(word) else math.nan
