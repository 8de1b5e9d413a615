"""Verdict in words: how the cloth lies, by its mesh."""

from __future__ import annotations

import numpy as np

from layflat.app.workstation.session.status import Verdict
from layflat.data.arrays import FloatArray

IN_AIR_M = 0.02
"""Height above which cloth does not lie: a wrinkle is lower, and so is a second layer."""
IN_AIR_SHARE, FOLDED_SHARE = 0.05, 0.01
TURNED = -0.3
"""Vertical part of a normal below which cloth lies on its face; a hanging cloth is near 0."""


def judge(contact: float, flat_area: float, success: bool, nodes: FloatArray | None) -> Verdict:
    """Judge a cloth; ``nodes`` are (rows, columns, 3) m, the free edge first and the left side last, or None."""
    kind = "flat" if success else "not flat" if nodes is None else describe_cloth(nodes)
    return Verdict(contact=contact, flat_area=flat_area, success=success, words=f"{100 * contact:.0f} %, {kind}")


def describe_cloth(nodes: FloatArray) -> str:
    """Return what keeps a cloth from being flat; nodes (rows, columns, 3) m."""
    if not np.isfinite(nodes).all():
        return "the simulation has diverged"
    up = np.cross(np.diff(nodes, axis=1)[:-1], np.diff(nodes, axis=0)[:, :-1])
    up /= np.maximum(np.linalg.norm(up, axis=-1, keepdims=True), 1e-12)
    folded, in_air = up[..., 2] < TURNED, nodes[..., 2] > IN_AIR_M
    if in_air.mean() > 0.5:
        return "in the air"
    if folded.mean() > FOLDED_SHARE:
        return f"folded over {_place(folded)}"
    if in_air.mean() > IN_AIR_SHARE:
        return f"in the air {_place(in_air)}"
    return "wrinkled"


def _place(where: np.ndarray) -> str:
    """Return where most of a mask (rows, columns) is, as a person at the robot's side says it."""
    row, column = (np.argwhere(where).mean(axis=0) / (np.array(where.shape) - 1)).tolist()
    edge = "the free edge" if row < 1 / 3 else "the held edge" if row > 2 / 3 else ""
    side = "right" if column < 1 / 3 else "left" if column > 2 / 3 else ""
    if edge and side:
        return f"at the {side} corner of {edge}"
    if edge:
        return f"at {edge}"
    return f"on the {side}" if side else "in the middle"
