"""FreePickers: two massless points that carry one corner each (chapter 4-2)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec, two_points
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import Cloth
from layflat.sim.robots.base import STIFFNESS_N_M, Control, Robot
from layflat.sim.robots.hand_guiding import HAND_SPEED_M_S

MIN_HEIGHT_M = 0.004
"""A picker never goes below the height at which cloth rests."""
MAX_SPREAD = 1.06
"""Distance of the pickers / width of the cloth at which they stop parting: real fingers would slip or tear."""


class FreePickers(Robot):
    """Kinematic pickers. Subclasses with a one-point `spec` move both of them together."""

    spec: ClassVar[RobotSpec] = two_points("pickers")
    start_step_m: ClassVar[float] = 0.004
    """Two pickers move independently: with 6 mm the hem between them falls slack and droops to the back in 6 of 22
    starts, with 4 mm in 2."""
    workspace_low_m = (-0.25, -0.45, MIN_HEIGHT_M)
    workspace_high_m = (0.75, 0.45, 0.80)

    def __init__(
        self,
        cloth: Cloth,
        corner_positions: FloatArray,
        *,
        control: Control = "impedance",
        stiffness_n_m: float = STIFFNESS_N_M,
    ) -> None:
        self._cloth = cloth
        self._corners = np.array(corner_positions, dtype=float)
        self._step = np.zeros((2, 3))
        """Displacement in one substep, m."""
        self._speeds: list[list[float]] = self._step.tolist()
        """Velocities, m/s, as lists, which an engine takes fastest."""
        self._holders = cloth.world.add_holders(self._corners)

    def corner_positions(self) -> FloatArray:
        return self._corners.copy()

    def position(self) -> FloatArray:
        return self._corners.mean(axis=0)

    def grasp(self) -> None:
        self._holders.grasp(self._cloth, self._cloth.spec.corners)

    def release(self) -> None:
        """Let go for good: the pickers vanish."""
        self._holders.release()

    def start_step(self, action: FloatArray, substeps: int) -> None:
        """Move the pickers by ``action`` (A,) m within the workspace."""
        self._move_to(self._corners + self.spec.unpack(action), substeps)

    def start_guided_step(self, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Follow the hand, or one hand each, at HAND_SPEED_M_S at most; pickers have no weight to feel."""
        held = self.position() if self.spec.n_points == 1 else self._corners
        step = np.zeros((self.spec.n_points, 3)) if hand_m is None else np.asarray(hand_m, dtype=float) - held
        longest = HAND_SPEED_M_S * substeps * self._cloth.world.substep_s
        size = np.linalg.norm(step, axis=-1, keepdims=True)
        self._move_to(self._corners + step * np.minimum(1.0, longest / np.maximum(size, 1e-12)), substeps)

    def _move_to(self, target: FloatArray, substeps: int) -> None:
        """Go there evenly in one step, as far as workspace and cloth allow."""
        target = self.within_reach(target, self._cloth.spec)
        substep_s = self._cloth.world.substep_s
        velocity = (target - self._corners) / (substeps * substep_s)
        self._step, self._speeds = velocity * substep_s, velocity.tolist()

    @classmethod
    def within_reach(cls, corners: FloatArray, cloth: ClothSpec) -> FloatArray:
        target: FloatArray = np.clip(corners, *cls.workspace(cloth))
        limit = MAX_SPREAD * cloth.width_m
        apart = target[0] - target[1]
        distance = float(np.linalg.norm(apart))
        if distance > limit:
            target = target.mean(axis=0) + np.array([0.5, -0.5])[:, None] * apart * (limit / distance)
        return target

    def before_substep(self) -> None:
        self._corners = self._corners + self._step
        self._holders.move(self._corners.tolist(), self._speeds)

    def hold(self) -> None:
        self._holders.stop()
