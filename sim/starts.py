"""Where an episode begins: how the cloth is hung up or laid, and what the holder does before anyone decides."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from data.types import FloatArray, Task, action_size
from sim.cloth import HELD_STRETCH, Cloth, ClothSpec
from sim.crumple import crumple
from sim.holder import Holder

Start: TypeAlias = Literal["hanging", "crumpled", "folded-corner", "swinging"]
STARTS: tuple[Start, ...] = ("hanging", "crumpled", "folded-corner", "swinging")

START_CLEARANCE_M = 0.12
"""The free edge hangs this high above the table before the random moves."""
START_MOVES = 20
START_STEP_M: Mapping[Task, float] = {"hanger": 0.006, "pickers": 0.004}
"""Largest random displacement along each axis in one of the start's ticks. Two pickers move independently: with 6 mm
the hem between them falls slack and droops to the back in 6 of 22 starts, with 4 mm in 2."""

LAID_FREE_EDGE_M = (-0.04, 0.14)
"""Where the free edge lies after a demonstration."""
LAID_HEIGHT_M = 0.0065
"""Of the held hem after a demonstration."""
LAID_STRETCH = 1.01
"""Of a cloth that was dragged taut."""
FOLD_LEG = (0.40, 0.60)
"""Legs of the corner that is folded over / width of the cloth, drawn for each edge."""
FOLD_RADIUS_MARGINS = 1.5
"""Of the fold / margin of the cloth: two layers are kept two margins apart."""
FOLD_TICKS = 25
"""The corner settles: after ten the crease still gave by millimetres."""

SWING_STEP_M = (0.016, 0.020)
"""Forth and back in one tick, drawn: 0.2 m/s is what nobody should move a hanging cloth with."""
SWING_TICKS = (5, 4)
"""Forth for half the cloth's period, then back: it swings to the front while its holder goes the other way."""
SWING_CLEARANCE_M = (0.0, 0.012)
"""How high above the table the free edge would be in the end if the cloth hung straight, drawn. From 0.02 m upwards it
swings back before it touches, and ends flat."""


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """A cloth that is to be put into a world."""

    corners: FloatArray
    """(2, 3) m: where the holder begins."""
    nodes: FloatArray
    """(N, 3) m."""
    about: Mapping[str, float]
    """What was drawn, for the episode's record."""


def home_corners(spec: ClothSpec) -> FloatArray:
    """(2, 3) m: the corners before the random moves; the free edge hangs over x = 0."""
    return _corners(spec, 0.0, spec.length_m + START_CLEARANCE_M)


def beginning(start: Start, spec: ClothSpec, rng: np.random.Generator) -> Beginning:
    """Where the holder and the cloth are when the world is made."""
    if start == "folded-corner":
        return _folded(spec, rng)
    corners = home_corners(spec)
    return Beginning(corners=corners, nodes=spec.hanging_nodes(corners), about={})


def begin(
    start: Start, cloth: Cloth, holder: Holder, tick: Callable[[FloatArray], None], rng: np.random.Generator
) -> Mapping[str, float]:
    """The holder's moves before anyone decides; ``tick`` is one control step. Returns what was drawn."""
    if start == "crumpled":
        return crumple(cloth, holder.corner_positions, tick, rng)
    size = action_size(holder.task)
    if start == "folded-corner":
        for _ in range(FOLD_TICKS):
            tick(np.zeros(size))
        return {}
    for _ in range(START_MOVES):
        tick(rng.uniform(-1.0, 1.0, size) * START_STEP_M[holder.task])
    return _swing(cloth, holder, tick, rng) if start == "swinging" else {}


def _corners(spec: ClothSpec, x_m: float, z_m: float) -> FloatArray:
    half = HELD_STRETCH * spec.width_m / 2
    return np.array([[x_m, half, z_m], [x_m, -half, z_m]])


def _folded(spec: ClothSpec, rng: np.random.Generator) -> Beginning:
    """Laid and dragged taut, then one corner of the free edge folded over (figure 5-2)."""
    x, legs, side = rng.uniform(*LAID_FREE_EDGE_M), rng.uniform(*FOLD_LEG, 2) * spec.width_m, rng.integers(2)
    grid = spec.flat_nodes().reshape(spec.rows, spec.columns, 3) * np.array([LAID_STRETCH, 1.0, 1.0])
    # The hem is held wider than the cloth is; the next rows follow it less and less.
    grid[..., 1] *= 1.0 + (HELD_STRETCH - 1.0) * np.linspace(0.0, 1.0, spec.rows)[:, None] ** 4
    grid[-1, :, 2] = LAID_HEIGHT_M
    nodes = fold_corner(grid.reshape(-1, 3), spec, (legs[0], legs[1]), left=bool(side))
    nodes[:, 0] += x
    return Beginning(
        corners=nodes[list(spec.corners)],
        nodes=nodes,
        about={"fold_along_m": float(legs[0]), "fold_across_m": float(legs[1]), "fold_side": 1.0 if side else -1.0},
    )


def fold_corner(nodes: FloatArray, spec: ClothSpec, legs_m: tuple[float, float], *, left: bool) -> FloatArray:
    """``nodes`` (N, 3) of a flat cloth with one corner of its free edge turned over onto the rest.

    ``legs_m``: how far from the corner the crease begins along x and along the free edge. ``left``: the corner at +y.
    """
    corner = nodes[0 if left else spec.columns - 1, :2]
    inwards = np.array([1.0, -1.0 if left else 1.0])
    along, across = np.array(legs_m) * inwards
    # Of the line through both ends of the crease: unit normal towards the corner.
    normal = -np.array([1.0 / along, 1.0 / across])
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


def _swing(
    cloth: Cloth, holder: Holder, tick: Callable[[FloatArray], None], rng: np.random.Generator
) -> Mapping[str, float]:
    """Forth, back and down too fast: the free edge swings ahead and is about to touch first (figure 5-1)."""
    speed, clearance = rng.uniform(*SWING_STEP_M), rng.uniform(*SWING_CLEARANCE_M)
    down = float(holder.position()[2]) - cloth.spec.length_m - clearance
    forth, back = SWING_TICKS
    for k in range(forth + back):
        move = np.array([speed if k < forth else -speed, 0.0, -down / (forth + back)])
        tick(move[[0, 2]] if holder.task == "hanger" else np.tile(move, 2))
    return {"swing_step_m": float(speed), "swing_clearance_m": float(clearance)}
