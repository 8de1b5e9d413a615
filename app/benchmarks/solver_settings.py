"""Published ways to simulate cloth in PyBullet, rebuilt from their sources, for the benchmark alone.

- DeformableRavens (Seita et al. 2021), ``ravens/robots/defs_cloth.py`` and ``environment.py``: 10 x 10 nodes, 0.2 m,
  0.5 kg, elastic 40, damping 0.1 not in all directions, margin a fifth of an edge, friction 1, self-collision, 480 Hz.
- DEDO (Antonova et al. 2021), ``dedo/utils/init_utils.py``, ``args.py`` and ``task_info.py``: 1 kg, elastic 50, damping
  0.1 in all directions, bending 1, friction 0.1, Bullet's own margin, self-collision, 500 Hz (8 steps an action). Its
  hanging cloth is 0.5 to 2 m wide, times 3; here it has the mean.

Both put it on Bullet's plane, which is a box of 200 m; robots, cameras and what else is in their scenes are left out,
here and in ours, so that cloth is compared with cloth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pybullet as bullet
import pybullet_data

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.cloth import Cloth, ClothSpec, mesh_file
from layflat.sim.physics.bullet.world import World

Situation = Literal["held", "flat"]
SITUATIONS: tuple[Situation, ...] = ("held", "flat")
"""Hanging from two corners; lying on the table."""

DROP_M = 0.01
"""Height above its margin from which a cloth is let fall to lie flat."""

HANG_LENGTHS = 2.5
"""Height of the held corners in lengths of the cloth: half a kilogram on springs of 40 N/m gets longer than it was."""


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """What its authors' calls of Bullet say."""

    name: str
    length_m: float
    mass_kg: float
    rate_hz: float
    friction: float
    springs: Mapping[str, float]
    """Further arguments of ``loadSoftBody``."""
    margin_of_edge: float | None = None
    """Collision margin over the distance of two nodes; None: Bullet's own."""
    engine: Mapping[str, float] | None = None
    """Arguments of ``setPhysicsEngineParameter``."""


RECIPES: Mapping[str, SolverSettings] = {
    recipe.name: recipe
    for recipe in (
        SolverSettings(
            name="DeformableRavens", length_m=0.2, mass_kg=0.5, rate_hz=480.0, friction=1.0, margin_of_edge=0.2,
            springs={"springElasticStiffness": 40, "springDampingStiffness": 0.1, "springDampingAllDirections": 0},
        ),
        SolverSettings(
            name="DEDO", length_m=3.75, mass_kg=1.0, rate_hz=500.0, friction=0.1,
            springs={
                "springElasticStiffness": 50, "springDampingStiffness": 0.1, "springDampingAllDirections": 1,
                "springBendingStiffness": 1,
            },
            engine={"sparseSdfVoxelSize": 0.25},
        ),
    )
}  # fmt: skip


class BareSimulation:
    """A cloth of ``across`` x ``across`` nodes by a recipe, in a world of its own, in one situation."""

    def __init__(self, recipe: SolverSettings, across: int, situation: Situation) -> None:
        self.substep_s = 1 / recipe.rate_hz
        self._client: int = bullet.connect(bullet.DIRECT)
        bullet.resetSimulation(bullet.RESET_USE_DEFORMABLE_WORLD, physicsClientId=self._client)
        bullet.setPhysicsEngineParameter(enableFileCaching=0, physicsClientId=self._client, **(recipe.engine or {}))
        bullet.setTimeStep(self.substep_s, physicsClientId=self._client)
        bullet.setGravity(0, 0, -9.8, physicsClientId=self._client)
        bullet.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=self._client)
        bullet.loadURDF("plane.urdf", physicsClientId=self._client)
        self._body = self._load(recipe, across, situation)
        if situation == "held":
            for node in (across * (across - 1), across * across - 1):
                bullet.createSoftBodyAnchor(self._body, node, -1, -1, physicsClientId=self._client)

    def _load(self, recipe: SolverSettings, across: int, situation: Situation) -> int:
        spec = grid(recipe.length_m, across)
        margin = None if recipe.margin_of_edge is None else recipe.margin_of_edge * recipe.length_m / (across - 1)
        low, high = (margin or 0.0) + DROP_M, HANG_LENGTHS * recipe.length_m
        nodes = spec.flat_nodes(z_m=low) if situation == "flat" else spec.hanging_nodes(_corners(recipe.length_m, high))
        more: dict[str, Any] = {} if margin is None else {"collisionMargin": margin}
        with mesh_file(nodes, spec.triangles()) as path:
            body = bullet.loadSoftBody(
                path,
                scale=1.0,
                mass=recipe.mass_kg,
                useNeoHookean=0,
                useMassSpring=1,
                useBendingSprings=1,
                useSelfCollision=1,
                useFaceContact=1,
                frictionCoeff=recipe.friction,
                physicsClientId=self._client,
                **recipe.springs,
                **more,
            )
        return int(body)

    def step(self) -> None:
        """One step of the recipe's length."""
        bullet.stepSimulation(physicsClientId=self._client)

    def nodes(self) -> FloatArray:
        """(N, 3) m."""
        _, vertices = bullet.getMeshData(
            self._body, -1, flags=bullet.MESH_DATA_SIMULATION_MESH, physicsClientId=self._client
        )
        return np.array(vertices)

    def close(self) -> None:
        bullet.disconnect(physicsClientId=self._client)


class BareLayflat:
    """Our own cloth in the same situation, in its own world, without holder, drag or guard."""

    def __init__(self, spec: ClothSpec, situation: Situation) -> None:
        self._world = World(substep_s=1 / spec.rate_hz, table_friction=1.0)
        self.substep_s = self._world.substep_s
        if situation == "flat":
            self._cloth = Cloth(self._world, spec, spec.flat_nodes(z_m=spec.margin_m + DROP_M))
            return
        nodes = spec.hanging_nodes(_corners(spec.width_m, HANG_LENGTHS * spec.length_m))
        self._cloth = Cloth(self._world, spec, nodes)
        for node in spec.corners:
            self._cloth.anchor(node, -1)

    def step(self) -> None:
        self._world.step()

    def nodes(self) -> FloatArray:
        return self._cloth.nodes()

    def close(self) -> None:
        self._world.close()


def grid(length_m: float, across: int) -> ClothSpec:
    """Our mesh in another size; what it is made of does not matter."""
    return ClothSpec(
        name="grid", length_m=length_m, width_m=length_m, rows=across, columns=across, mass_kg=1.0, elastic_n_m=1.0,
        damping_n_s_m=1.0, bending_n_m=1.0,
    )  # fmt: skip


def _corners(width_m: float, height_m: float) -> FloatArray:
    return np.array([[0.0, width_m / 2, height_m], [0.0, -width_m / 2, height_m]])
