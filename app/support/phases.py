"""Phases and disturbances of a recorded episode, and the contact portion at their ends."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from layflat.data.types import Episode, Phase


@dataclass(frozen=True, kw_only=True)
class PhaseSpan:
    """Consecutive steps of one phase."""

    phase: Phase
    first: int
    end: int
    """Index into ``observations()`` at which the phase was over."""


@dataclass(frozen=True, kw_only=True)
class DisturbanceOutcome:
    """Camera contact portion (0..1) around one disturbance."""

    name: str
    before: float
    """When the disturbance began."""
    disturbed: float
    """When it was over."""
    final: float
    """When the next disturbance began, or at the end of the episode."""

    @property
    def regained(self) -> float:
        """Contact portion won back after the disturbance."""
        return self.final - self.disturbed


def phase_spans(episode: Episode) -> tuple[PhaseSpan, ...]:
    """Return the spans of an episode in their order; empty for an episode without steps."""
    spans: list[PhaseSpan] = []
    first = 0
    for phase, steps in groupby(step.phase for step in episode.steps):
        end = first + len(list(steps))
        spans.append(PhaseSpan(phase=phase, first=first, end=end))
        first = end
    return tuple(spans)


def placed_step(episode: Episode) -> int | None:
    """Return the index into ``observations()`` at which the place phase ended, None without such a phase."""
    bounds = episode.phase_bounds("place")
    return bounds[1] if bounds else None


def disturbed_step(episode: Episode) -> int | None:
    """Return the index into ``observations()`` at which the last disturbance was over, None without any."""
    spans = disturbed_spans(episode)
    return spans[-1][1] if spans else None


def disturbed_spans(episode: Episode) -> tuple[tuple[int, int], ...]:
    """Return the first step of each disturbance and the index into ``observations()`` at which it was over.

    A recorded disturbance without an end lasted to the end of the episode. In an episode without records, each span
    of the phase ``disturb`` is a disturbance.
    """
    n_steps = len(episode.steps)
    if episode.disturbances:
        ends = [n_steps if r.last_step is None else r.last_step + 1 for r in episode.disturbances]
        return tuple((r.first_step, end) for r, end in zip(episode.disturbances, ends, strict=True))
    return tuple((span.first, span.end) for span in phase_spans(episode) if span.phase == "disturb")


def disturbance_outcomes(episode: Episode) -> tuple[DisturbanceOutcome, ...]:
    """Return the outcome of each disturbance in their order (the thesis's Table 4-2 has repeated ones)."""
    contact = np.clip(episode.contact(), 0.0, 1.0)
    spans = disturbed_spans(episode)
    names = [record.name for record in episode.disturbances] or [episode.disturbance] * len(spans)
    finals = [*(first for first, _ in spans[1:]), len(episode.steps)]
    return tuple(
        DisturbanceOutcome(
            name=name, before=float(contact[first]), disturbed=float(contact[end]), final=float(contact[final])
        )
        for name, (first, end), final in zip(names, spans, finals, strict=False)
    )
