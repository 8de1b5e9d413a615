"""MujocoCloth: a flexible sheet, each node a body with three degrees of freedom."""

from __future__ import annotations

from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import Cloth, World
from layflat.sim.physics.mujoco.model_text import CLOTH, cloth_text


class MujocoCloth(Cloth):
    """The cloth of a world."""

    def __init__(self, world: World, spec: ClothSpec, nodes: FloatArray) -> None:
        """``nodes``: (N, 3) m, its shape at rest."""
        super().__init__(spec)
        self.world = world
        self.text = cloth_text(spec, nodes)
        self._at_rest = np.array(nodes, dtype=float)
        self._forces = np.zeros_like(self._at_rest)
        self._displacement: Any = np.zeros(self._at_rest.size)
        self._speed: Any = np.zeros(self._at_rest.size)
        """Positions from there and velocities: views of MuJoCo's data once it is compiled."""
        self._part = slice(0, 0)
        self._nodes: FloatArray | None = None
        self._nodes_at = -1

    def nodes(self) -> FloatArray:
        if self._nodes is None or self._nodes_at != self.world.substeps_done:
            nodes = self._at_rest + self._displacement.reshape(-1, 3)
            nodes.setflags(write=False)
            self._nodes, self._nodes_at = nodes, self.world.substeps_done
        return self._nodes

    def velocities(self) -> FloatArray:
        return self._speed.reshape(-1, 3).copy()

    def push(self, nodes: list[int], forces_n: FloatArray) -> None:
        """Apply forces (K, 3) N, world, to nodes in the next substep."""
        np.add.at(self._forces, nodes, forces_n)

    def restored(self, last_seen: tuple[float, FloatArray] | None) -> None:
        """Forget what was computed from another state."""
        self._nodes, self.last_seen = None, last_seen

    def enter(self, model: Any, data: Any) -> None:
        first = int(model.jnt_qposadr[model.body_jntadr[model.body(f"{CLOTH}_0").id]])
        dof = int(model.jnt_dofadr[model.body_jntadr[model.body(f"{CLOTH}_0").id]])
        size = self._at_rest.size
        data.qpos[first : first + size] = self._displacement
        data.qvel[dof : dof + size] = self._speed
        self._part = slice(dof, dof + size)
        self._displacement, self._speed = data.qpos[first : first + size], data.qvel[self._part]
        self._nodes = None

    def apply_forces(self, data: Any) -> None:
        data.qfrc_applied[self._part] = self._forces.ravel()
        self._forces[:] = 0.0


def mujoco_cloth(cloth: Cloth) -> MujocoCloth:
    """Return a cloth of this engine as one."""
    if not isinstance(cloth, MujocoCloth):
        raise TypeError(f"a {type(cloth).__name__} is not in a MuJoCo world")
    return cloth
