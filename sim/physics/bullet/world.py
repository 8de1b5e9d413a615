"""The sole owner of the Bullet client: deformable world, gravity, table, substeps.

Facts of PyBullet that shape this file, each with the test that would notice if it went away: soft cloth with
anchors exists only in the deformable world; OBJ files are cached by path; the table must be a box, never a plane
(GJK runs every cloth face against a convex shape), and costs half as much with maximal coordinates.
"""

from __future__ import annotations

import math

import pybullet as bullet

from layflat.sim.errors import SimError

GRAVITY_M_S2 = 9.81
TABLE_SIZE_M = (1.6, 1.4, 0.1)
TABLE_CENTRE_M = (0.3, 0.0)
TABLE_RGBA = (0.86, 0.86, 0.84, 1.0)


class World:
    """One deformable Bullet world in DIRECT mode; one per process, never shared between threads."""

    def __init__(self, *, substep_s: float, table_friction: float) -> None:
        """Make an empty world with a table whose top is z = 0.

        Parameters
        ----------
        substep_s: physics step (substep), s, as long as nobody asks for a finer one.
        table_friction: Coulomb coefficient of the table, >= 0; Bullet multiplies it with the cloth's.
        """
        if not 0.0 < substep_s <= 1 / 100:
            raise SimError(f"the physics step is {substep_s} s; it must be above 0 and at most 0.01 s")
        if not 0.0 <= table_friction <= 5.0:
            raise SimError(f"the table's friction is {table_friction}; it must be between 0 and 5")
        self.coarse_substep_s = self.substep_s = substep_s
        self.substeps_done = 0
        self.halves_done = 0
        """Time in halves of a coarse step: a whole number, so that what is not refined keeps its times to the bit."""
        self.client: int = bullet.connect(bullet.DIRECT)
        if self.client < 0:
            raise SimError("Bullet did not give a client; close other simulations in this process")
        bullet.resetSimulation(bullet.RESET_USE_DEFORMABLE_WORLD, physicsClientId=self.client)
        bullet.setPhysicsEngineParameter(enableFileCaching=0, fixedTimeStep=substep_s, physicsClientId=self.client)
        self.set_gravity((0.0, 0.0, -GRAVITY_M_S2))
        self.table = self._make_table(table_friction)

    def _make_table(self, friction: float) -> int:
        half = [s / 2 for s in TABLE_SIZE_M]
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=self.client)
        visual = bullet.createVisualShape(
            bullet.GEOM_BOX, halfExtents=half, rgbaColor=TABLE_RGBA, physicsClientId=self.client
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

    def set_gravity(self, gravity_m_s2: tuple[float, float, float]) -> None:
        """Uniform acceleration of all that moves, m/s^2, world axes."""
        if not all(math.isfinite(g) for g in gravity_m_s2):
            raise SimError(f"gravity is {gravity_m_s2}; it must be finite")
        self.gravity_m_s2 = gravity_m_s2
        bullet.setGravity(*gravity_m_s2, physicsClientId=self.client)

    def step(self) -> None:
        """One substep."""
        bullet.stepSimulation(physicsClientId=self.client)
        self.substeps_done += 1
        self.halves_done += 2 if self.substep_s == self.coarse_substep_s else 1

    def refine(self, finer: bool) -> int:
        """Halve the step from now on, or make it whole again; how many substeps one coarse step then has."""
        parts = 2 if finer else 1
        if self.substep_s != self.coarse_substep_s / parts:
            self.substep_s = self.coarse_substep_s / parts
            bullet.setPhysicsEngineParameter(fixedTimeStep=self.substep_s, physicsClientId=self.client)
        return parts

    def halves(self, duration_s: float) -> int:
        """A duration in whole coarse steps, at least one, counted as ``halves_done`` is."""
        return 2 * max(1, round(duration_s / self.coarse_substep_s))

    def seconds(self, halves: int) -> float:
        return halves * (self.coarse_substep_s / 2)

    @property
    def time_s(self) -> float:
        return self.seconds(self.halves_done)

    def close(self) -> None:
        """Give the client back; the world is unusable afterwards."""
        if self.client >= 0:
            bullet.disconnect(physicsClientId=self.client)
            self.client = -1
