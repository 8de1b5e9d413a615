"""TinyRenderer, Bullet's own, as an independent implementation of what the camera draws."""

from __future__ import annotations

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.sim.physics.base import FAR_M, NEAR_M


class TinyRenderer:
    """The visible bodies of a Bullet client before one pinhole."""

    def __init__(self, client: int, pinhole: PinholeCamera, light: FloatArray) -> None:
        self._client = client
        self._size = (pinhole.width, pinhole.height)
        flip = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL's camera looks along -z with y up
        self._view = np.linalg.inv(pinhole.cam_to_world @ flip).T.ravel().tolist()
        self._projection = _projection(pinhole)
        self._light = (10 * light).tolist()

    def draw(self) -> tuple[NDArray[np.intp], NDArray[np.float32], NDArray[np.uint8]]:
        rgba, buffer = bullet.getCameraImage(
            *self._size,
            self._view,
            self._projection,
            lightDirection=self._light,
            shadow=0,
            renderer=bullet.ER_TINY_RENDERER,
            flags=bullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._client,
        )[2:4]
        buffer = np.asarray(buffer, dtype=np.float32).reshape(-1)
        hit = np.flatnonzero(buffer < 1.0 - 1e-6)
        depth = np.float32(FAR_M * NEAR_M) / (FAR_M - (FAR_M - NEAR_M) * buffer[hit])
        return hit, depth, np.asarray(rgba, dtype=np.uint8).reshape(-1, 4)[hit, :3]


def _projection(pinhole: PinholeCamera) -> list[float]:
    """Return the OpenGL projection matrix, column by column, whose image is the pinhole's."""
    # TinyRenderer samples at whole pixels and turns the image upside down: column u lies at 2 u / W - 1 of its view,
    # row v at 2 (H - 1 - v) / H - 1. The test against the rasterizer would notice a shift.
    return list(
        bullet.computeProjectionMatrix(
            -pinhole.cx / pinhole.fx * NEAR_M,
            (pinhole.width - pinhole.cx) / pinhole.fx * NEAR_M,
            -(pinhole.height - 1 - pinhole.cy) / pinhole.fy * NEAR_M,
            (pinhole.cy + 1) / pinhole.fy * NEAR_M,
            NEAR_M,
            FAR_M,
        )
    )
