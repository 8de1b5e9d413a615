"""ReplayScene: a recorded cloth before the simulation's cameras again, in a world that is never stepped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.sim.camera.camera import Camera, recorded_pinhole
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.registry import DEFAULT_PHYSICS, cloth_world
from layflat.sim.robots.registry import robot_type


class ReplayScene:
    """Shows cloth nodes, and the arm where the robot has one, as they were, its hand straight down.

    Files hold the corners alone, and the milliradians by which a yielding hand tilts are not visible in an image.
    """

    def __init__(self, robot: str, cloth: ClothSpec, camera: CameraModel | None = None) -> None:
        """Make the scene of a robot, by name, and a cloth; SimError lists the known robots. ``camera`` looks at it."""
        self.spec = cloth
        self._robot = robot_type(robot)
        self._world = cloth_world(DEFAULT_PHYSICS, self.spec)
        body = self._world.add_cloth(self.spec)
        self._arm = self._robot.add_arm(self._world, self.spec)
        self._camera = Camera(body, pinhole=recorded_pinhole(camera, cloth), noise=None, seed=0)

    def capture(self, nodes: FloatArray, holder: FloatArray) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return rgb (H, W, 3) and depth (H, W) m without noise; ``nodes`` (N, 3) m and ``holder`` (3,) m, world."""
        self._pose(nodes, holder)
        return self._camera.capture(nodes)

    def render(self, nodes: FloatArray, holder: FloatArray, width: int, height: int) -> NDArray[np.uint8]:
        """Return rgb (height, width, 3) for people, from in front of the robot; arguments as in `capture`."""
        self._pose(nodes, holder)
        return self._camera.render(width, height, nodes=nodes)

    def close(self) -> None:
        """Free the world."""
        self._world.close()

    def __enter__(self) -> ReplayScene:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _pose(self, nodes: FloatArray, holder: FloatArray) -> None:
        wanted = (self.spec.n_nodes, 3)
        if nodes.shape != wanted:
            raise SimError(f"the cloth has nodes of shape {nodes.shape}; a {self.spec.name} has {wanted}")
        if self._arm is not None:
            self._arm.reset_joints(self._robot.joint_angles_at(holder, self.spec))
