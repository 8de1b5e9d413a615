"""BulletWorld: the owner of the Bullet client, with its deformable world, gravity, table and substeps.

Facts of PyBullet that shape this file, each with a test that would notice if it changed: soft cloth with anchors exists
only in the deformable world; OBJ files are cached by path; the table must be a box, never a plane (GJK runs every cloth
face against a convex shape), and costs half as much with maximal coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2, TABLE_CENTRE_M, TABLE_SIZE_M, Cloth, Vector, World
from layflat.sim.physics.bullet.air_drag import AirDrag
from layflat.sim.physics.bullet.arm import BulletArm
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.physics.bullet.force_anchors import BulletForceAnchors
from layflat.sim.physics.bullet.holders import BulletHolders
from layflat.sim.physics.bullet.solid_renderer import HIDDEN, BulletSolidRenderer


class BulletWorld(World):
    """One deformable Bullet world in DIRECT mode; never shared between threads."""

    def __init__(self, *, substep_s: float, table_friction: float) -> None:
        super().__init__(substep_s=substep_s, table_friction=table_friction)
        self.client: int = bullet.connect(bullet.DIRECT)
        if self.client < 0:
            raise SimError("Bullet did not give a client; close other simulations in this process")
        bullet.resetSimulation(bullet.RESET_USE_DEFORMABLE_WORLD, physicsClientId=self.client)
        bullet.setPhysicsEngineParameter(enableFileCaching=0, fixedTimeStep=substep_s, physicsClientId=self.client)
        self._wind: Vector | None = None
        self._air: AirDrag | None = None
        self._bodies_seen = -1
        self._has_solids = False
        self.set_gravity((0.0, 0.0, -GRAVITY_M_S2))
        self.drawn_elsewhere = {self._make_table(table_friction)}
        """Bodies that Bullet's renderer does not show: the table and the cloths."""

    def _make_table(self, friction: float) -> int:
        half = [s / 2 for s in TABLE_SIZE_M]
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        visual = bullet.createVisualShape(
            bullet.GEOM_BOX, halfExtents=half, rgbaColor=HIDDEN, physicsClientId=self.client
        )
        body = bullet.createMultiBody(
            0.0,
            shape,
            visual,
            basePosition=(*TABLE_CENTRE_M, -half[2]),
            useMaximalCoordinates=True,
            physicsClientId=self.client,
        )
        bullet.changeDynamics(body, -1, lateralFriction=friction, physicsClientId=self.client)
        return int(body)

    def add_cloth(self, spec: ClothSpec, nodes: FloatArray | None = None) -> BulletCloth:
        cloth = BulletCloth(self, self.client, spec, spec.flat_nodes(z_m=0.5) if nodes is None else nodes)
        self.drawn_elsewhere.add(cloth.body)
        return cloth

    def add_air(self, cloth: Cloth) -> None:
        self._air = AirDrag(cloth, self.set_gravity)

    def add_holders(self, positions_m: FloatArray) -> BulletHolders:
        return BulletHolders(self.client, positions_m)

    def add_force_anchors(self, cloth: Cloth, nodes: Sequence[int], force_limit_n: float) -> BulletForceAnchors:
        return BulletForceAnchors(self.client, cloth, nodes, force_limit_n)

    def add_arm(self, urdf: bytes, base_position_m: Vector, *, joints: int, tool_m: float) -> BulletArm:
        return BulletArm(self.client, urdf, base_position_m, joints, tool_m)

    def set_gravity(self, gravity_m_s2: Vector) -> None:
        """Set the uniform acceleration of all that moves, wind apart, m/s^2, world axes."""
        if not all(math.isfinite(g) for g in gravity_m_s2):
            raise SimError(f"gravity is {gravity_m_s2}; it must be finite")
        self._still_gravity = gravity_m_s2
        self._apply_gravity()

    def set_wind(self, acceleration_m_s2: Vector | None) -> None:
        # Gravity is the one uniform force that Bullet gives to all nodes.
        self._wind = acceleration_m_s2
        self._apply_gravity()

    def _apply_gravity(self) -> None:
        x, y, z = self._still_gravity
        if self._wind is not None:
            x, y, z = x + self._wind[0], y + self._wind[1], z + self._wind[2]
        self.gravity_m_s2 = (x, y, z)
        bullet.setGravity(x, y, z, physicsClientId=self.client)

    def begin_substep(self) -> None:
        if self._air is not None:
            self._air.update()

    def step(self) -> None:
        bullet.stepSimulation(physicsClientId=self.client)
        self.substeps_done += 1
        self.ticks_done += self._ticks

    def _apply_substep(self) -> None:
        bullet.setPhysicsEngineParameter(fixedTimeStep=self.substep_s, physicsClientId=self.client)

    def solid_renderer(self, pinhole: PinholeCamera, light: FloatArray) -> BulletSolidRenderer:
        return BulletSolidRenderer(self.client, pinhole, light)

    def has_solids(self) -> bool:
        # Asked for every image, so the bodies are looked through only when some have come or gone.
        client = self.client
        count = bullet.getNumBodies(physicsClientId=client)
        if count != self._bodies_seen:
            bodies = {bullet.getBodyUniqueId(i, physicsClientId=client) for i in range(count)} - self.drawn_elsewhere
            self._has_solids = any(bullet.getVisualShapeData(body, physicsClientId=client) for body in bodies)
            self._bodies_seen = count
        return self._has_solids

    def close(self) -> None:
        if self.client >= 0:
            bullet.disconnect(physicsClientId=self.client)
            self.client = -1
