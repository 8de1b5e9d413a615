"""BulletCloth: a mass-spring soft body whose nodes can be anchored to rigid bodies."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.data.names import ascii_folder
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import Cloth, World


class BulletCloth(Cloth):
    """One soft body of a world."""

    def __init__(self, world: World, client: int, spec: ClothSpec, nodes: FloatArray) -> None:
        super().__init__(spec)
        self.world = world
        self._client = client
        self._nodes: FloatArray | None = None
        self._nodes_at = 0
        self.body = self._load(nodes)

    def _load(self, nodes: FloatArray) -> int:
        spec, client = self.spec, self._client
        with temporary_file(".obj", obj_mesh(nodes, self._triangles)) as path:
            body = bullet.loadSoftBody(
                path,
                scale=1.0,
                mass=spec.mass_kg,
                useNeoHookean=0,
                useMassSpring=1,
                useBendingSprings=1,
                springElasticStiffness=spec.elastic_n_m,
                springDampingStiffness=spec.damping_n_s_m,
                springDampingAllDirections=0,
                springBendingStiffness=spec.bending_n_m,
                useSelfCollision=1,
                frictionCoeff=spec.friction,
                useFaceContact=1,
                collisionMargin=spec.margin_m,
                physicsClientId=client,
            )
        # A cloth that hung still for about a second falls asleep and then ignores its moving anchors.
        bullet.changeDynamics(
            body, -1, activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=client
        )
        return int(body)

    def nodes(self) -> FloatArray:
        # A step's last nodes are the first of the next.
        if self._nodes is not None and self._nodes_at == self.world.substeps_done:
            return self._nodes
        # Without the flag Bullet gives duplicated render vertices.
        _, vertices = bullet.getMeshData(
            self.body, -1, flags=bullet.MESH_DATA_SIMULATION_MESH, physicsClientId=self._client
        )
        # Twice as fast as np.array on a tuple of tuples; the air drag asks every 20 ms.
        nodes = np.fromiter(chain.from_iterable(vertices), dtype=float).reshape(-1, 3)
        nodes.setflags(write=False)
        self._nodes, self._nodes_at = nodes, self.world.substeps_done
        return nodes

    def anchor(self, node: int, body: int, link: int = -1) -> int:
        """Fix a node to a link where both are now; return a constraint for `remove_anchor`."""
        return int(bullet.createSoftBodyAnchor(self.body, node, body, link, physicsClientId=self._client))

    def remove_anchor(self, constraint: int) -> None:
        """Free an anchored node."""
        bullet.removeConstraint(constraint, physicsClientId=self._client)


@contextmanager
def temporary_file(suffix: str, content: bytes) -> Iterator[str]:
    """Write a file that Bullet reads, and give its path, which was never used: Bullet caches meshes by path."""
    handle, path = tempfile.mkstemp(suffix=suffix)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        with ascii_folder(Path(path)) as name:
            yield name
    finally:
        os.unlink(path)


def obj_mesh(nodes: FloatArray, triangles: np.ndarray) -> bytes:
    """Return nodes (N, 3) m and triangles (T, 3) as an OBJ file."""
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in nodes]
    lines += [f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles]
    return "".join(lines).encode()


def bullet_cloth(cloth: Cloth) -> BulletCloth:
    """Return a cloth of this engine as one."""
    if not isinstance(cloth, BulletCloth):
        raise TypeError(f"a {type(cloth).__name__} is not in a Bullet world")
    return cloth
