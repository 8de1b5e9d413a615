"""Start: how an episode begins, from where the cloth is made to what the robot does before the first observation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.disturbances.presets import DisturbanceSpec, DisturbanceTrajectory
from layflat.sim.physics.base import TICKS, Cloth
from layflat.sim.robots.base import Robot
from layflat.sim.robots.pickers import FreePickers

START_CLEARANCE_M = 0.12
"""The free edge hangs this high above the table before a start's moves."""
ATTACH_S = 0.25
"""Time in which a cloth's corners are pulled from where they are at rest to where the robot takes them."""


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """A cloth to put into a world."""

    corners: FloatArray
    """Where the robot begins, (2, 3) m."""
    nodes: FloatArray
    """The cloth without tension, near there, (N, 3) m."""


@dataclass(frozen=True, kw_only=True)
class StartScene:
    """The simulation as a start's moves see it."""

    cloth: Cloth
    robot: Robot
    step: Callable[[FloatArray], None]
    """Simulates one control step."""
    disturb: Callable[[DisturbanceSpec], DisturbanceTrajectory]
    """Starts a disturbance and returns what was drawn."""
    rng: np.random.Generator


def hanging_state(spec: ClothSpec, robot: type[Robot], rng: np.random.Generator) -> InitialState:
    """Return a cloth that hangs in the air, a little narrower than the robot holds it."""
    corners = home_corners(spec)
    return InitialState(corners=corners, nodes=spec.hanging_nodes(narrowed(corners, spec)))


def narrowed(corners: FloatArray, cloth: ClothSpec) -> FloatArray:
    """Return held corners (2, 3) m, level and symmetric about y = 0, as far apart as the cloth is wide at rest."""
    return corners / np.array([1.0, cloth.held_stretch, 1.0])


@dataclass(frozen=True, kw_only=True)
class Start:
    """One way in which an episode begins."""

    name: str
    move: Callable[[StartScene], Mapping[str, float]]
    """Makes the moves before the first observation; returns what was drawn, by name."""
    initial_state: Callable[[ClothSpec, type[Robot], np.random.Generator], InitialState] = field(default=hanging_state)
    two_points: bool = False
    """Whether the robot has to move each corner on its own."""


def home_corners(spec: ClothSpec) -> FloatArray:
    """Return the corners (2, 3) m before a start's moves."""
    return spec.corners_at(spec.home_x_m, spec.length_m + START_CLEARANCE_M)


def attach(cloth: Cloth, corners: FloatArray) -> None:
    """Pull the cloth's held corners to ``corners`` (2, 3) m: nodes that are set wider would be its shape at rest."""
    world = cloth.world
    at = cloth.nodes()[list(cloth.spec.corners)]
    fingers = FreePickers(cloth, at)
    fingers.grasp()
    substeps = world.ticks(ATTACH_S) // TICKS
    fingers.start_step((corners - at).ravel(), substeps)
    for _ in range(substeps):
        world.begin_substep()
        fingers.before_substep()
        world.step()
    fingers.release()
