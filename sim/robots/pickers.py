"""Two free pickers (chapter 4-2): massless bodies that carry one corner each, three axes each."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec, two_points
from layflat.sim.cloth.cloth import Cloth
from layflat.sim.robots.base import Control
from layflat.sim.robots.hand_guiding import HAND_SPEED_M_S

MIN_HEIGHT_M = 0.004
"""A picker never goes below the height at which cloth rests."""
WORKSPACE_LOW_M = np.array([-0.25, -0.45, MIN_HEIGHT_M])
WORKSPACE_HIGH_M = np.array([0.75, 0.45, 0.80])
MAX_SPREAD = 1.06
"""Distance of the pickers / width of the cloth at which they stop parting: real fingers would slip or tear."""


class FreePickers:
    """Kinematic pickers; anchor error is one substep of motion."""

    spec: ClassVar[RobotSpec] = two_points("pickers")
    start_step_m: ClassVar[float] = 0.004
    """Two pickers move independently: with 6 mm the hem between them falls slack and droops to the back in 6 of 22
    starts, with 4 mm in 2."""

    def __init__(self, cloth: Cloth, corner_positions: FloatArray, *, control: Control = "impedance") -> None:
        """Hold ``cloth`` at ``corner_positions`` (2, 3) m, row 0 at +y."""
        self._cloth = cloth
        self._client = cloth.world.client
        self._at = np.array(corner_positions, dtype=float)
        self._step = np.zeros((2, 3))
        """m in one substep."""
        self._speeds: list[list[float]] = self._step.tolist()
        """m/s, as Bullet takes them soonest."""
        self._anchors: list[int] = []
        self._bodies = [
            int(bullet.createMultiBody(0.0, basePosition=p.tolist(), physicsClientId=self._client)) for p in self._at
        ]

    def corner_positions(self) -> FloatArray:
        return self._at.copy()

    def position(self) -> FloatArray:
        return self._at.mean(axis=0)

    def joint_angles(self) -> FloatArray:
        return np.zeros(0)

    def grip(self) -> None:
        held = zip(self._cloth.spec.corners, self._bodies, strict=True)
        self._anchors = [self._cloth.anchor(node, body) for node, body in held]

    def release(self) -> None:
        """For good: the pickers are gone."""
        for anchor in self._anchors:
            self._cloth.release(anchor)
        for body in self._bodies:
            bullet.removeBody(body, physicsClientId=self._client)
        self._anchors, self._bodies = [], []

    def start_step(self, action: FloatArray, substeps: int) -> None:
        """``action`` (6,) m: dx, dy, dz of picker 1, then of picker 2; kept inside the workspace."""
        self._lead_to(self._at + np.asarray(action).reshape(2, 3), substeps)

    def start_guided_step(self, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Each picker follows its own hand (2, 3) m, at HAND_SPEED_M_S at most; they have no weight to feel."""
        step = np.zeros((2, 3)) if hand_m is None else np.asarray(hand_m, dtype=float) - self._at
        longest = HAND_SPEED_M_S * substeps * self._cloth.world.substep_s
        size = np.linalg.norm(step, axis=1, keepdims=True)
        self._lead_to(self._at + step * np.minimum(1.0, longest / np.maximum(size, 1e-12)), substeps)

    def _lead_to(self, wanted: FloatArray, substeps: int) -> None:
        """Go there evenly in one step, as far as workspace and cloth allow."""
        wanted = np.clip(wanted, WORKSPACE_LOW_M, WORKSPACE_HIGH_M)
        limit = MAX_SPREAD * self._cloth.spec.width_m
        apart = wanted[0] - wanted[1]
        distance = float(np.linalg.norm(apart))
        if distance > limit:
            wanted = wanted.mean(axis=0) + np.array([0.5, -0.5])[:, None] * apart * (limit / distance)
        substep_s = self._cloth.world.substep_s
        velocity = (wanted - self._at) / (substeps * substep_s)
        self._step, self._speeds = velocity * substep_s, velocity.tolist()

    def before_substep(self) -> None:
        self._at = self._at + self._step
        for body, position, velocity in zip(self._bodies, self._at.tolist(), self._speeds, strict=True):
            bullet.resetBasePositionAndOrientation(body, position, (0, 0, 0, 1), physicsClientId=self._client)
            # The solver takes the anchor's velocity from the body, not from its change of place.
            bullet.resetBaseVelocity(body, velocity, physicsClientId=self._client)

    def rest(self) -> None:
        for body in self._bodies:
            bullet.resetBaseVelocity(body, (0, 0, 0), physicsClientId=self._client)
