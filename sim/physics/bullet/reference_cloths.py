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
from typing import Literal

import numpy as np
import pybullet as bullet
import pybullet_data

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.bullet.cloth import obj_mesh, temporary_file
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


class BareCloth:
    """A cloth in a world of its own, without robot, air and checks."""

    def __init__(self, client: int, body: int, substep_s: float) -> None:
        self._client, self._body = client, body
        self.substep_s = substep_s

    def step(self) -> None:
        """Simulate one substep."""
        bullet.stepSimulation(physicsClientId=self._client)

    def nodes(self) -> FloatArray:
        """Return the nodes, (N, 3) m."""
        flags = bullet.MESH_DATA_SIMULATION_MESH
        return np.array(bullet.getMeshData(self._body, -1, flags=flags, physicsClientId=self._client)[1])

    def close(self) -> None:
        """Free the world."""
        bullet.disconnect(physicsClientId=self._client)


def reference_cloth(settings: SolverSettings, across: int, situation: Situation) -> BareCloth:
    """Make a cloth of ``across`` x ``across`` nodes with published settings."""
    client: int = bullet.connect(bullet.DIRECT)
    bullet.resetSimulation(bullet.RESET_USE_DEFORMABLE_WORLD, physicsClientId=client)
    bullet.setPhysicsEngineParameter(enableFileCaching=0, physicsClientId=client, **(settings.engine or {}))
    bullet.setTimeStep(1 / settings.rate_hz, physicsClientId=client)
    bullet.setGravity(0, 0, -9.8, physicsClientId=client)
    bullet.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=client)
    bullet.loadURDF("plane.urdf", physicsClientId=client)
    spec, margin = grid(settings.length_m, across), {}
    if settings.margin_of_edge is not None:
        margin = {"collisionMargin": settings.margin_of_edge * settings.length_m / (across - 1)}
    nodes = _nodes(spec, situation, margin.get("collisionMargin", 0.0))
    with temporary_file(".obj", obj_mesh(nodes, spec.triangles())) as path:
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
            physicsClientId=client,
            **settings.springs,
            **margin,
        )
    if situation == "held":
        for node in spec.corners:
            bullet.createSoftBodyAnchor(body, node, -1, -1, physicsClientId=client)
    return BareCloth(client, body, 1 / settings.rate_hz)


def layflat_cloth(spec: ClothSpec, situation: Situation) -> BareCloth:
    """Make Layflat's cloth in the same situation."""
    world = BulletWorld(substep_s=1 / spec.rate_hz, table_friction=1.0)
    cloth = world.add_cloth(spec, _nodes(spec, situation, spec.margin_m))
    if situation == "held":
        for node in spec.corners:
            cloth.anchor(node, -1)
    return BareCloth(world.client, cloth.body, world.substep_s)


def grid(length_m: float, across: int) -> ClothSpec:
    """Return Layflat's mesh in another size, of no particular material."""
    return ClothSpec(
        name="grid", length_m=length_m, width_m=length_m, rows=across, columns=across, mass_kg=1.0, elastic_n_m=1.0,
        damping_n_s_m=1.0, bending_n_m=1.0,
    )  # fmt: skip


def _nodes(spec: ClothSpec, situation: Situation, margin_m: float) -> FloatArray:
    if situation == "flat":
        return spec.flat_nodes(z_m=margin_m + DROP_M)
    side, up = spec.width_m / 2, HANG_LENGTHS * spec.length_m
    return spec.hanging_nodes(np.array([[0.0, side, up], [0.0, -side, up]]))
