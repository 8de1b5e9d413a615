"""Speed of Layflat's cloth beside published cloths: all in one process, block by block in turns."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from layflat.app.benchmarks.rows import BenchmarkRow, Samples, speed_row
from layflat.data.arrays import FloatArray
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.physics.bullet.reference_cloths import (
    SITUATIONS,
    SOLVER_SETTINGS,
    BareCloth,
    layflat_cloth,
    reference_cloth,
)

OURS = "ours"
NODES = (10, 13)
"""Nodes along an edge: as DeformableRavens has, and as our default cloth has."""
SETTLE_S, BLOCK_S, BLOCKS = 0.5, 0.1, 6
"""Simulated time before the measurement and of a block, and the number of blocks."""


def published_cloths(nodes: int, cloth: str, settle_s: float = SETTLE_S, blocks: int = BLOCKS) -> dict[str, FloatArray]:
    """Return wall s per simulated s of stepping alone, by "situation name"."""
    spec = replace(cloth_spec(cloth), rows=nodes, columns=nodes)
    samples: dict[str, FloatArray] = {}
    for situation in SITUATIONS:
        worlds = {OURS: layflat_cloth(spec, situation)}
        worlds |= {name: reference_cloth(settings, nodes, situation) for name, settings in SOLVER_SETTINGS.items()}
        try:
            for world in worlds.values():
                _measure(world, settle_s)
            walls: dict[str, list[float]] = {name: [] for name in worlds}
            for _ in range(blocks):
                for name, world in worlds.items():
                    walls[name].append(_measure(world, BLOCK_S))
        finally:
            for world in worlds.values():
                world.close()
        samples |= {f"{situation} {name}": np.array(wall) for name, wall in walls.items()}
    return samples


def rows(nodes: int, samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return ours beside each published cloth, in each situation."""
    return [
        speed_row(
            f"bare cloth {nodes} x {nodes} {situation} / {name}",
            samples[f"{situation} {OURS}"],
            samples[f"{situation} {name}"],
        )
        for situation in SITUATIONS
        for name in SOLVER_SETTINGS
    ]


def _measure(world: BareCloth, simulated_s: float) -> float:
    """Step and return wall s per simulated s."""
    steps = round(simulated_s / world.substep_s)
    began = time.perf_counter()
    for _ in range(steps):
        world.step()
    return (time.perf_counter() - began) / (steps * world.substep_s)
