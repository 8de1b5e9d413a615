"""BulletWorld: the owner of the Bullet client, with its deformable world, gravity, table and substeps.

Facts of PyBullet that shape this file, each with a test that would notice if it changed: soft cloth with anchors exists
only in the deformable world; OBJ files are cached by path; the table must be a box, never a plane (GJK runs every cloth
face against a convex shape), and costs half as much with maximal coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence

import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.air_drag import AirDrag
from layflat.sim.physics.base import GRAVITY_M_S2, TABLE_CENTRE_M, TABLE_SIZE_M, Cloth, Vector, World
from layflat.sim.physics.bullet.arm import BulletArm
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.physics.bullet.force_anchors import BulletForceAnchors
from layflat.sim.physics.bullet.holders import BulletHolders


class BulletWorld(World):
    """One deformable Bullet world in DIRECT mode; never shared between threads."""

    def __init__(self, *, substep_s: float, table_friction: float) -> None:
        super().__init__(substep_s=substep_s, table_friction=table_friction)
        self.client: int = bullet.connect(bullet.DIRECT)
        if self.client < 0:
            raise SimError("Bullet did not give a client; close other simulations in this process")
        bullet.resetSimulation(bullet.RESET_USE_DEFORMABLE_WORLD, physicsClientId=self.client)
        bullet.setPhysicsEngineParameter(enableFileCaching=0, fixedTimeStep=substep_s, physicsClientId=self.client)
        self.set_gravity((0.0, 0.0, -GRAVITY_M_S2))
        self._make_table(table_friction)

    def _make_table(self, friction: float) -> None:
        half = [s / 2 for s in TABLE_SIZE_M]
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        body = bullet.createMultiBody(
            0.0,
            shape,
            basePosition=(*TABLE_CENTRE_M, -half[2]),
            useMaximalCoordinates=True,
            physicsClientId=self.client,
        )
        bullet.changeDynamics(body, -1, lateralFriction=friction, physicsClientId=self.client)

    def add_cloth(self, spec: ClothSpec, nodes: FloatArray | None = None) -> BulletCloth:
        return BulletCloth(self, self.client, spec, spec.flat_nodes(z_m=0.5) if nodes is None else nodes)

    def add_air(self, cloth: Cloth) -> None:
        self._air = AirDrag(cloth, self.set_gravity)

    def add_holders(self, positions_m: FloatArray) -> BulletHolders:
        return BulletHolders(self.client, positions_m)

    def add_force_anchors(self, cloth: Cloth, nodes: Sequence[int], force_limit_n: float) -> BulletForceAnchors:
        return BulletForceAnchors(self.client, cloth, nodes, force_limit_n)

    def add_arm(self, urdf: bytes, base_position_m: Vector, *, joints: int, tool_m: float) -> BulletArm:
        return BulletArm(self.client, urdf, base_position_m, joints, tool_m)

    def _apply_gravity(self) -> None:
        # Gravity is the one uniform force that Bullet gives to all nodes.
        bullet.setGravity(*self.gravity_m_s2, physicsClientId=self.client)

    def step(self) -> None:
        bullet.stepSimulation(physicsClientId=self.client)
        self.substeps_done += 1
        self.ticks_done += self._ticks

    def _apply_substep(self) -> None:
        bullet.setPhysicsEngineParameter(fixedTimeStep=self.substep_s, physicsClientId=self.client)

    def close(self) -> None:
        if self.client >= 0:
            bullet.disconnect(physicsClientId=self.client)
            self.client = -1
