"""Published ways to simulate cloth in PyBullet, rebuilt from their sources, for the benchmark only.

- DeformableRavens (Seita et al. 2021), ``ravens/robots/defs_cloth.py`` and ``environment.py``: 10 x 10 nodes, 0.2 m,
  0.5 kg, elastic 40, damping 0.1 not in all directions, margin a fifth of an edge, friction 1, self-collision, 480 Hz.
- DEDO (Antonova et al. 2021), ``dedo/utils/init_utils.py``, ``args.py`` and ``task_info.py``: 1 kg, elastic 50, damping
  0.1 in all directions, bending 1, friction 0.1, Bullet's own margin, self-collision, 500 Hz (8 steps an action). Its
  hanging cloth is 0.5 to 2 m wide, times 3; here it has the mean.

Both put it on Bullet's plane, which is a box of 200 m; robots, cameras and the rest of their scenes are left out, here
and in ours, so that cloth is compared with cloth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pybullet as bullet
import pybullet_data

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.bullet.cloth import mesh_file
from layflat.sim.physics.bullet.world import BulletWorld

Situation = Literal["held", "flat"]
SITUATIONS: tuple[Situation, ...] = ("held", "flat")
"""Hanging from two corners; lying on the table."""

DROP_M = 0.01
"""Height above its margin from which a cloth is let fall to lie flat."""

HANG_LENGTHS = 2.5
"""Height of the held corners / length of the cloth: half a kilogram on springs of 40 N/m stretches a lot."""


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """Arguments of its authors' calls of Bullet."""

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


SOLVER_SETTINGS: Mapping[str, SolverSettings] = {
    settings.name: settings
    for settings in (
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


class ReferenceCloth:
    """A cloth of ``across`` x ``across`` nodes with published settings, in a world of its own."""

    def __init__(self, settings: SolverSettings, across: int, situation: Situation) -> None:
        self.substep_s = 1 / settings.rate_hz
        self._client: int = bullet.connect(bullet.DIRECT)
        bullet.resetSimulation(bullet.RESET_USE_DEFORMABLE_WORLD, physicsClientId=self._client)
        bullet.setPhysicsEngineParameter(enableFileCaching=0, physicsClientId=self._client, **(settings.engine or {}))
        bullet.setTimeStep(self.substep_s, physicsClientId=self._client)
        bullet.setGravity(0, 0, -9.8, physicsClientId=self._client)
        bullet.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=self._client)
        bullet.loadURDF("plane.urdf", physicsClientId=self._client)
        self._body = self._load(settings, across, situation)
        if situation == "held":
            for node in (across * (across - 1), across * across - 1):
                bullet.createSoftBodyAnchor(self._body, node, -1, -1, physicsClientId=self._client)

    def _load(self, settings: SolverSettings, across: int, situation: Situation) -> int:
        spec = grid(settings.length_m, across)
        margin = None if settings.margin_of_edge is None else settings.margin_of_edge * settings.length_m / (across - 1)
        low, high = (margin or 0.0) + DROP_M, HANG_LENGTHS * settings.length_m
        nodes = (
            spec.flat_nodes(z_m=low) if situation == "flat" else spec.hanging_nodes(_corners(settings.length_m, high))
        )
        more: dict[str, Any] = {} if margin is None else {"collisionMargin": margin}
        with mesh_file(nodes, spec.triangles()) as path:
            body = bullet.loadSoftBody(
                path,
                scale=1.0,
                mass=settings.mass_kg,
                useNeoHookean=0,
                useMassSpring=1,
                useBendingSprings=1,
                useSelfCollision=1,
                useFaceContact=1,
                frictionCoeff=settings.friction,
                physicsClientId=self._client,
                **settings.springs,
                **more,
            )
        return int(body)

    def step(self) -> None:
        """Simulate one step of the settings' length."""
        bullet.stepSimulation(physicsClientId=self._client)

    def nodes(self) -> FloatArray:
        """Return the nodes, (N, 3) m."""
        _, vertices = bullet.getMeshData(
            self._body, -1, flags=bullet.MESH_DATA_SIMULATION_MESH, physicsClientId=self._client
        )
        return np.array(vertices)

    def close(self) -> None:
        """Free the world."""
        bullet.disconnect(physicsClientId=self._client)


class LayflatCloth:
    """Layflat's cloth in the same situation, in its own world, without robot, air and checks."""

    def __init__(self, spec: ClothSpec, situation: Situation) -> None:
        self._world = BulletWorld(substep_s=1 / spec.rate_hz, table_friction=1.0)
        self.substep_s = self._world.substep_s
        if situation == "flat":
            self._cloth = self._world.add_cloth(spec, spec.flat_nodes(z_m=spec.margin_m + DROP_M))
            return
        nodes = spec.hanging_nodes(_corners(spec.width_m, HANG_LENGTHS * spec.length_m))
        self._cloth = self._world.add_cloth(spec, nodes)
        for node in spec.corners:
            self._cloth.anchor(node, -1)

    def step(self) -> None:
        """Simulate one substep."""
        self._world.step()

    def nodes(self) -> FloatArray:
        """Return the nodes, (N, 3) m."""
        return self._cloth.nodes()

    def close(self) -> None:
        """Free the world."""
        self._world.close()


def grid(length_m: float, across: int) -> ClothSpec:
    """Return Layflat's mesh in another size, of no particular material."""
    return ClothSpec(
        name="grid", length_m=length_m, width_m=length_m, rows=across, columns=across, mass_kg=1.0, elastic_n_m=1.0,
        damping_n_s_m=1.0, bending_n_m=1.0,
    )  # fmt: skip


def _corners(width_m: float, height_m: float) -> FloatArray:
    return np.array([[0.0, width_m / 2, height_m], [0.0, -width_m / 2, height_m]])
