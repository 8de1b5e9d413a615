"""The cloth hangs in the air after random moves, or swings to the front low over the table (figure 5-1)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.robots.base import Robot
from layflat.sim.starts.base import InitialState, Start, StartScene, home_corners, narrowed

START_MOVES = 20
QUICK_MOVES = 4
"""Moves of a quick start that are simulated; the ones before only say where it begins."""
SWING_STEP_M = (0.016, 0.020)
"""Displacement to and fro in one step, drawn: 0.2 m/s is too fast for a hanging cloth."""
SWING_STEPS = (5, 4)
"""Steps to the front for half the cloth's period, then back: it swings to the front while the robot moves back."""
SWING_CLEARANCE_M = (0.0, 0.012)
"""Height of the free edge above the table in the end if the cloth hung straight, drawn. From 0.02 m upwards it swings
back before it touches, and ends flat."""


def _move_randomly(scene: StartScene, n_moves: int = START_MOVES) -> Mapping[str, float]:
    robot = scene.robot
    for _ in range(n_moves):
        scene.step(scene.rng.uniform(-1.0, 1.0, robot.spec.size) * robot.start_step_m)
    return {}


def _moved_state(cloth: ClothSpec, robot: type[Robot], rng: np.random.Generator) -> InitialState:
    """Return a cloth that hangs where the first moves would have carried it."""
    home = corners = home_corners(cloth)
    for _ in range(START_MOVES - QUICK_MOVES):
        move = robot.spec.unpack(rng.uniform(-1.0, 1.0, robot.spec.size) * robot.start_step_m)
        corners = robot.within_reach(corners + move, cloth)
    # Made level and as wide as at rest: `attach` draws the corners to where the robot takes them.
    level = narrowed(home, cloth) + corners.mean(axis=0) - home.mean(axis=0)
    return InitialState(corners=corners, nodes=cloth.hanging_nodes(level))


def _swing(scene: StartScene) -> Mapping[str, float]:
    """Move to the front, back and down too fast: the free edge swings ahead and is about to touch first."""
    _move_randomly(scene)
    robot, rng = scene.robot, scene.rng
    speed, clearance = rng.uniform(*SWING_STEP_M), rng.uniform(*SWING_CLEARANCE_M)
    down = float(robot.position()[2]) - scene.cloth.spec.length_m - clearance
    ahead, back = SWING_STEPS
    for k in range(ahead + back):
        move = np.array([speed if k < ahead else -speed, 0.0, -down / (ahead + back)])
        scene.step(robot.spec.pack(move))
    return {"swing_step_m": float(speed), "swing_clearance_m": float(clearance)}


HANGING = Start(name="hanging", move=_move_randomly)
HANGING_QUICK = Start(
    name="hanging-quick", move=partial(_move_randomly, n_moves=QUICK_MOVES), initial_state=_moved_state
)
"""At the place of `HANGING` with the same seed, after a third of its simulation."""
SWINGING = Start(name="swinging", move=_swing)
