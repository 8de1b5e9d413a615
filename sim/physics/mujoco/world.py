"""MujocoWorld: a world whose whole state can be saved."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, ClassVar

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.air_drag import AirDrag
from layflat.sim.physics.base import Cloth, Vector, World
from layflat.sim.physics.mujoco.arm import MujocoArm
from layflat.sim.physics.mujoco.cloth import MujocoCloth
from layflat.sim.physics.mujoco.engine import Engine
from layflat.sim.physics.mujoco.force_anchors import MujocoForceAnchors
from layflat.sim.physics.mujoco.holders import MujocoHolders

RATE_HZ = 200.0
"""At 100 Hz a corner goes through the cloth in 2 of 8 folds by hand, at 200 Hz in none of 8."""


class MujocoWorld(World):
    """One world; not shared between threads."""

    saves_state: ClassVar[bool] = True

    def __init__(self, *, substep_s: float, table_friction: float) -> None:
        super().__init__(substep_s=substep_s, table_friction=table_friction)
        self._engine = Engine(table_friction)
        self._cloth: MujocoCloth | None = None
        self._apply_substep()
        self.set_gravity(self._still_gravity)

    @classmethod
    def rate_hz(cls, spec: ClothSpec) -> float:
        return RATE_HZ

    def add_cloth(self, spec: ClothSpec, nodes: FloatArray | None = None) -> MujocoCloth:
        cloth = self._cloth = MujocoCloth(self, spec, spec.flat_nodes(z_m=0.5) if nodes is None else nodes)
        self._engine.add("cloth", cloth)
        # As in Bullet the factors are multiplied.
        self._engine.table_friction *= spec.friction
        return cloth

    def add_air(self, cloth: Cloth) -> None:
        self._air = AirDrag(cloth, self.set_gravity)

    def add_holders(self, positions_m: FloatArray) -> MujocoHolders:
        return MujocoHolders(self._engine, positions_m)

    def add_force_anchors(self, cloth: Cloth, nodes: Sequence[int], force_limit_n: float) -> MujocoForceAnchors:
        return MujocoForceAnchors(self._engine, cloth, nodes, force_limit_n)

    def add_arm(self, urdf: bytes, base_position_m: Vector, *, joints: int, tool_m: float) -> MujocoArm:
        arm = MujocoArm(self._engine, urdf, base_position_m, joints, tool_m)
        self._engine.add("arm", arm)
        return arm

    def step(self) -> None:
        self._engine.step()
        self.substeps_done += 1
        self.ticks_done += self._ticks

    def _apply_substep(self) -> None:
        self._engine.substep_s = self.substep_s
        self._engine.set_options()

    def _apply_gravity(self) -> None:
        self._engine.gravity_m_s2 = self.gravity_m_s2
        self._engine.set_options()

    def save(self) -> Any:
        return self._engine.save(), copy.deepcopy(vars(self)), self._cloth and self._cloth.last_seen

    def restore(self, state: Any) -> None:
        engine, own, last_seen = state
        vars(self).update(copy.deepcopy(own))
        self._apply_gravity()
        self._apply_substep()
        self._engine.restore(engine)
        if self._cloth is not None:
            self._cloth.restored(last_seen)

    def close(self) -> None:
        self._engine.close()
