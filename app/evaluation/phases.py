"""Stretches of an episode: one phase each, in their order; and the disturbances with what came of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layflat.data.types import Episode, Phase


@dataclass(frozen=True, kw_only=True)
class PhaseSpan:
    """Steps of one phase on end."""

    phase: Phase
    first: int
    after: int
    """Index into ``observations()`` of the moment at which it was over."""


@dataclass(frozen=True, kw_only=True)
class DisturbanceOutcome:
    """One disturbance: camera contact (0..1) just before it, when it was over, and when the repair after it was."""

    before: float
    disturbed: float
    repaired: float

    @property
    def regained(self) -> float:
        return self.repaired - self.disturbed


def phase_spans(episode: Episode) -> tuple[PhaseSpan, ...]:
    """The whole episode; empty for one without steps."""
    phases = [step.phase for step in episode.steps]
    begins = [
        step_index for step_index, phase in enumerate(phases) if step_index == 0 or phase != phases[step_index - 1]
    ]
    return tuple(
        PhaseSpan(phase=phases[first], first=first, after=after)
        for first, after in zip(begins, [*begins[1:], len(phases)], strict=True)
    )


def disturbance_outcomes(episode: Episode) -> tuple[DisturbanceOutcome, ...]:
    """Every disturbance that ended; its repair may be missing, and then ends where it began.

    A disturbance after which nothing moved for a step and the next one form one stretch, so count as one.
    """
    contact = np.clip(episode.contact(), 0.0, 1.0)
    parts = phase_spans(episode)
    found = []
    for k, part in enumerate(parts):
        if part.phase == "disturb":
            after = parts[k + 1].after if k + 1 < len(parts) else part.after
            found.append(
                DisturbanceOutcome(
                    before=float(contact[part.first]),
                    disturbed=float(contact[part.after]),
                    repaired=float(contact[after]),
                )
            )
    return tuple(found)
