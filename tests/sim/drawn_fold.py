"""A cloth with a corner folded over, drawn: for what looks at a mesh, not for what simulates it."""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec

RADIUS_MARGINS = 1.5
"""Of the fold / margin of the cloth: two layers are kept two margins apart."""


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
    radius = RADIUS_MARGINS * spec.margin_m
    turn = np.clip(beyond / radius, 0.0, np.pi)
    ahead = radius * np.sin(turn) - np.maximum(beyond - np.pi * radius, 0.0)
    folded = nodes.copy()
    folded[:, :2] += np.where(beyond > 0, ahead - beyond, 0.0)[:, None] * normal
    folded[:, 2] += radius * (1.0 - np.cos(turn))
    return folded
