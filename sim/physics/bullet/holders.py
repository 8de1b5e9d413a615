"""BulletHolders: massless bodies that carry nodes of a cloth; the anchors' error is one substep of motion."""

from __future__ import annotations

from collections.abc import Sequence

import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Cloth
from layflat.sim.physics.bullet.cloth import BulletCloth, bullet_cloth


class BulletHolders:
    """Kinematic points."""

    def __init__(self, client: int, positions_m: FloatArray) -> None:
        self._client = client
        self._cloth: BulletCloth | None = None
        self._anchors: list[int] = []
        self._bodies = [
            int(bullet.createMultiBody(0.0, basePosition=p.tolist(), physicsClientId=client)) for p in positions_m
        ]

    def grasp(self, cloth: Cloth, nodes: Sequence[int]) -> None:
        self._cloth = bullet_cloth(cloth)
        self._anchors = [self._cloth.anchor(*pair) for pair in zip(nodes, self._bodies, strict=True)]

    def move(self, positions_m: Sequence[list[float]], velocities_m_s: Sequence[list[float]]) -> None:
        for body, position, velocity in zip(self._bodies, positions_m, velocities_m_s, strict=True):
            bullet.resetBasePositionAndOrientation(body, position, (0, 0, 0, 1), physicsClientId=self._client)
            # The solver takes the anchor's velocity from the body, not from its change of place.
            bullet.resetBaseVelocity(body, velocity, physicsClientId=self._client)

    def stop(self) -> None:
        for body in self._bodies:
            bullet.resetBaseVelocity(body, (0, 0, 0), physicsClientId=self._client)

    def release(self) -> None:
        for anchor in self._anchors:
            if self._cloth is not None:
                self._cloth.remove_anchor(anchor)
        for body in self._bodies:
            bullet.removeBody(body, physicsClientId=self._client)
        self._anchors, self._bodies = [], []
