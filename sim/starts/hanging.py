"""The cloth hangs in the air after random moves, or swings to the front low over the table (figure 5-1)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from layflat.sim.starts.base import Start, StartScene

START_MOVES = 20
SWING_STEP_M = (0.016, 0.020)
"""Displacement to and fro in one step, drawn: 0.2 m/s is too fast for a hanging cloth."""
SWING_STEPS = (5, 4)
"""Steps to the front for half the cloth's period, then back: it swings to the front while the robot moves back."""
SWING_CLEARANCE_M = (0.0, 0.012)
"""Height of the free edge above the table in the end if the cloth hung straight, drawn. From 0.02 m upwards it swings
back before it touches, and ends flat."""


def _move_randomly(scene: StartScene) -> Mapping[str, float]:
    robot = scene.robot
    for _ in range(START_MOVES):
        scene.step(scene.rng.uniform(-1.0, 1.0, robot.spec.size) * robot.start_step_m)
    return {}


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
SWINGING = Start(name="swinging", move=_swing)
