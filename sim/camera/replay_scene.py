"""Recorded cloth before the bench's cameras again: a world that is looked at and never stepped."""

from __future__ import annotations

from types import TracebackType

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.sim.camera.camera import Camera
from layflat.sim.cloth.cloth import HELD_STRETCH, Cloth, cloth_spec
from layflat.sim.errors import SimError
from layflat.sim.physics.bullet.world import World
from layflat.sim.robots.panda import inverse_kinematics, load_arm
from layflat.sim.robots.registry import robot_type


class ReplayScene:
    """Shows cloth nodes, and the arm where the robot has one, as they were.

    The arm's joints follow from where its hanger was, hand straight down: files hold the corners, and the few
    milliradians by which an impedance-controlled hand tilts are not seen in a picture.
    """

    def __init__(self, robot: str, cloth: str) -> None:
        """``cloth`` is a preset's name; SimError lists the known ones."""
        self.spec = cloth_spec(cloth)
        self._world = World(substep_s=1.0 / self.spec.rate_hz, table_friction=1.0)
        body = Cloth(self._world, self.spec)
        self._arm = (
            load_arm(self._world.client, HELD_STRETCH * self.spec.width_m)
            if robot_type(robot).spec.n_points == 1
            else None
        )
        self._camera = Camera(self._world, body, noise=None, seed=0)

    def capture(self, nodes: FloatArray, holder: FloatArray) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """rgb (H, W, 3) and depth (H, W) m of the bench's own camera, without sensor noise.

        ``nodes`` (N, 3) m and ``holder`` (3,) m, world, as in Truth and Observation.
        """
        self._pose(nodes, holder)
        return self._camera.capture(nodes)

    def render(self, nodes: FloatArray, holder: FloatArray, width: int, height: int) -> NDArray[np.uint8]:
        """rgb (height, width, 3) for people, from in front of the robot; arguments as in ``capture``."""
        self._pose(nodes, holder)
        return self._camera.render(width, height, nodes=nodes)

    def close(self) -> None:
        self._world.close()

    def __enter__(self) -> ReplayScene:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _pose(self, nodes: FloatArray, holder: FloatArray) -> None:
        wanted = (self.spec.rows * self.spec.columns, 3)
        if nodes.shape != wanted:
            raise SimError(f"the cloth has nodes of shape {nodes.shape}; a {self.spec.name} has {wanted}")
        if self._arm is not None:
            for joint, angle in enumerate(inverse_kinematics(holder)):
                bullet.resetJointState(self._arm, joint, float(angle), 0.0, physicsClientId=self._world.client)
