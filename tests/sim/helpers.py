"""Small cloths, worlds and simulations for the tests of the simulation."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.config import SimConfig
from layflat.sim.physics.base import Cloth, World
from layflat.sim.physics.bullet.cloth import BulletCloth, bullet_cloth
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.simulation import ClothSimulation

FOLD_RADIUS_MARGINS = 1.5
"""Radius of a drawn fold / margin of the cloth: two layers are kept two margins apart."""


def small_cloth(side_m: float = 0.2, rows: int = 7, columns: int = 7, **changes: Any) -> ClothSpec:
    """Return a light cloth of a few nodes, which costs little to simulate."""
    values = {"name": "small", "length_m": side_m, "width_m": side_m, "rows": rows, "columns": columns}
    values |= {"mass_kg": 0.02, "elastic_n_m": 40.0, "damping_n_s_m": 0.12, "bending_n_m": 0.1}
    return ClothSpec(**(values | changes))


@contextmanager
def bullet_world(rate_hz: float = 240.0, table_friction: float = 1.0) -> Iterator[BulletWorld]:
    """Give an empty Bullet world."""
    world = BulletWorld(substep_s=1 / rate_hz, table_friction=table_friction)
    try:
        yield world
    finally:
        world.close()


@contextmanager
def cloth_in_world(spec: ClothSpec, nodes: FloatArray | None = None, **world: float) -> Iterator[BulletCloth]:
    """Give a cloth in a Bullet world of its own, put at ``nodes``."""
    with bullet_world(spec.rate_hz, **world) as made:
        cloth = made.add_cloth(spec)
        if nodes is not None:
            set_nodes(cloth, nodes)
        yield cloth


def set_nodes(cloth: Cloth, nodes: FloatArray) -> None:
    """Move the nodes (N, 3) m there; Bullet keeps their velocities and makes this the shape at rest."""
    body = bullet_cloth(cloth)
    bullet.resetMeshData(body.body, nodes.tolist(), physicsClientId=body._client)
    body._nodes = body.last_seen = None


def run(world: World, substeps: int, *before: Callable[[], None]) -> None:
    """Simulate substeps; ``before`` are called first in each, after the air."""
    for _ in range(substeps):
        world.begin_substep()
        for call in before:
            call()
        world.step()


def n_bodies(world: Any) -> int:
    """Return the number of bodies in a Bullet world."""
    return int(bullet.getNumBodies(physicsClientId=world.client))


@contextmanager
def simulation(robot: str = "pickers", seed: int | None = 0, **config: Any) -> Iterator[ClothSimulation]:
    """Give a simulation of a napkin without a camera, reset to ``seed`` unless it is None."""
    made = ClothSimulation(SimConfig(**({"robot": robot, "cloth": "napkin", "camera": False} | config)))
    try:
        if seed is not None:
            made.reset(seed)
        yield made
    finally:
        made.close()


def fresh_process_outputs(script: str, *arguments: Sequence[str]) -> list[str]:
    """Return the last word that ``script`` prints in a fresh process for each of the argument lists."""
    running = [
        subprocess.Popen([sys.executable, "-c", script, *words], stdout=subprocess.PIPE, text=True)
        for words in arguments
    ]
    return [process.communicate(timeout=110)[0].split()[-1] for process in running]


def fold_corner(nodes: FloatArray, spec: ClothSpec, legs_m: tuple[float, float], *, left: bool) -> FloatArray:
    """Return a flat cloth's ``nodes`` with one corner of its free edge turned over onto the rest.

    ``legs_m``: distance of the crease's ends from the corner along x and along the free edge. ``left``: corner at +y.
    """
    corner = nodes[0 if left else spec.columns - 1, :2]
    along, across = np.array(legs_m) * np.array([1.0, -1.0 if left else 1.0])
    normal = -np.array([1.0 / along, 1.0 / across])  # of the crease, towards the corner
    normal /= np.linalg.norm(normal)
    beyond = (nodes[:, :2] - corner - np.array([along, 0.0])) @ normal
    # Around a cylinder that leaves room for both layers: a sharp crease would press springs together, and burst.
    radius = FOLD_RADIUS_MARGINS * spec.margin_m
    turn = np.clip(beyond / radius, 0.0, np.pi)
    ahead = radius * np.sin(turn) - np.maximum(beyond - np.pi * radius, 0.0)
    folded = nodes.copy()
    folded[:, :2] += np.where(beyond > 0, ahead - beyond, 0.0)[:, None] * normal
    folded[:, 2] += radius * (1.0 - np.cos(turn))
    return folded
