"""Rewards of the Gymnasium environment, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from layflat.data.types import GroundTruth
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.starts.base import START_CLEARANCE_M

FLAT_WEIGHT = 0.75
"""Share of the flat area in the potential; the rest is how low the cloth is."""


@dataclass(frozen=True, kw_only=True)
class Situation:
    """State of an episode, as far as rewards need it."""

    contact_portion: float
    """As the camera sees it, 0..1."""
    potential: float
    """See `potential`; 0 for a cloth that came apart."""
    is_success: bool


def potential(truth: GroundTruth, cloth: ClothSpec) -> float:
    """Return how far the cloth has come: about 0.1 where it hangs, 0.3 in a heap, 1 where it lies flat.

    Phi = 0.75 * flat area + 0.25 * (1 - mean height / height of the held edge at home). The height grows less with
    each step down, so a learner has a signal before cloth touches the table; the flat area tells a heap from a laid
    cloth, and counts a reverse side negative.
    """
    height = float(np.mean(truth.nodes[:, 2])) / (cloth.length_m + START_CLEARANCE_M)
    return FLAT_WEIGHT * truth.flat_area + (1.0 - FLAT_WEIGHT) * (1.0 - min(max(height, 0.0), 1.0))


REWARDS: Mapping[str, Callable[[Situation, Situation], float]] = {
    "contact": lambda before, now: now.contact_portion - before.contact_portion,
    "shaped": lambda before, now: now.potential - before.potential,
    "sparse": lambda before, now: float(now.is_success),
}
"""Name -> reward of a step, from the situations before and after it."""
DEFAULT_REWARD = "contact"
