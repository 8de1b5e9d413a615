"""Disturbances as they act in an episode: drawn by its seed, or as they were recorded."""

from __future__ import annotations

import numpy as np

from layflat.data.types import DisturbanceRecord
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.disturbances.presets import DisturbanceSpec, DisturbanceTrajectory, disturbance_spec

DISTURBANCE_STREAM = 0xD157
"""Separates the random numbers of disturbances from others of the same seed."""


def draw_disturbance(
    disturbance: str | DisturbanceSpec | DisturbanceRecord, *, seed: int, repeat: int, cloth: ClothSpec
) -> tuple[DisturbanceTrajectory, DisturbanceRecord | None]:
    """Return what is done to ``cloth``, and its record; None where it does nothing.

    A record is repeated exactly, or by its name where it has no plan. ``repeat`` is the number of disturbances of the
    episode before it, so that each is drawn independently.
    """
    name = disturbance if isinstance(disturbance, str) else disturbance.name
    if isinstance(disturbance, DisturbanceRecord) and disturbance.plan:
        plan = DisturbanceTrajectory.recorded(disturbance.plan, cloth)
    else:
        spec = disturbance if isinstance(disturbance, DisturbanceSpec) else disturbance_spec(name)
        stream = [seed, DISTURBANCE_STREAM, *([repeat] if repeat else [])]
        plan = spec.sample(np.random.default_rng(stream), cloth)
    return plan, DisturbanceRecord(name=name, first_step=0, plan=plan.described()) if plan.acts else None
