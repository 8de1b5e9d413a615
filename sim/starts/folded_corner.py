"""The cloth lies flat with a far corner folded over (figure 5-2)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.disturbances.presets import disturbance_spec
from layflat.sim.robots.base import Robot
from layflat.sim.starts.base import InitialState, Start, StartScene

LAID_FREE_EDGE_M = (-0.04, 0.14)
"""Range of the free edge's x after a demonstration, from where it hung at the start."""
LAID_HEIGHT_M = 0.0065
"""Height of the held hem after a demonstration."""
LAID_STRETCH = 1.01
"""Stretch of a laid cloth that a robot draws taut."""
FOLD = "fold-corner"
"""The disturbance that turns the corner over."""
FOLD_STEPS = 35
"""The hand's two seconds at most, and one in which the corner settles."""
CALM_STEPS = 3
"""Steps in which the laid cloth comes to rest."""


def _laid_taut(spec: ClothSpec, robot: type[Robot], rng: np.random.Generator) -> InitialState:
    x = spec.home_x_m + rng.uniform(*LAID_FREE_EDGE_M)
    corners = spec.corners_at(x + LAID_STRETCH * spec.length_m, LAID_HEIGHT_M)
    return InitialState(corners=corners, nodes=spec.flat_nodes(x_m=x))


def _fold(scene: StartScene) -> Mapping[str, float]:
    """Let a hand turn one corner of the free edge over; set nodes would be the shape at rest and stay creased."""
    rest = scene.robot.spec.zeros()
    for _ in range(CALM_STEPS):
        scene.step(rest)
    reach = scene.disturb(disturbance_spec(FOLD)).path_m[-1]
    for _ in range(FOLD_STEPS):
        scene.step(rest)
    return {
        "fold_along_m": float(reach[0]),
        "fold_across_m": float(abs(reach[1])),
        "fold_side": -float(np.sign(reach[1])),
    }


FOLDED_CORNER = Start(name="folded-corner", move=_fold, initial_state=_laid_taut)
