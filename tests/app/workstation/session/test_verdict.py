"""Verdicts in words, on meshes of which it is known how they lie."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.app.workstation.session.verdict import describe_cloth, judge
from layflat.data.types import FLAT_AREA
from layflat.sim.cloth.geometry import ClothGeometry
from layflat.sim.cloth.registry import cloth_spec

SPEC = cloth_spec("towel")
LAYER_M = 0.004


def flat() -> np.ndarray:
    """Return the nodes (rows, columns, 3) m of a flat towel: the free edge at x = 0, the left side at -y."""
    return SPEC.flat_nodes().reshape(SPEC.rows, SPEC.columns, 3)


def folded(axis: int, at_m: float, *, below: bool) -> np.ndarray:
    """Fold what lies below (or above) a line over onto the rest."""
    nodes = flat()
    over = nodes[..., axis] < at_m if below else nodes[..., axis] > at_m
    nodes[over, axis] = 2 * at_m - nodes[over, axis]
    nodes[over, 2] += LAYER_M
    return nodes


def corner(free: bool, left: bool) -> np.ndarray:
    """Fold a corner over along a diagonal."""
    nodes = flat()
    x = nodes[..., 0] if free else SPEC.length_m - nodes[..., 0]
    y = nodes[..., 1] + SPEC.width_m / 2 if left else SPEC.width_m / 2 - nodes[..., 1]
    over = x + y < 0.11
    new_x, new_y = 0.11 - y, 0.11 - x
    nodes[..., 0][over] = (new_x if free else SPEC.length_m - new_x)[over]
    nodes[..., 1][over] = (new_y - SPEC.width_m / 2 if left else SPEC.width_m / 2 - new_y)[over]
    nodes[over, 2] += LAYER_M
    return nodes


def raised(rows: slice) -> np.ndarray:
    nodes = flat()
    nodes[rows, :, 2] += 0.06
    return nodes


def wavy() -> np.ndarray:
    nodes = flat()
    nodes[..., 2] += 0.008 * (1 + np.sin(nodes[..., 0] / 0.012))
    return nodes


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        (folded(0, 0.06, below=True), "folded over at the free edge"),
        (folded(0, SPEC.length_m - 0.06, below=False), "folded over at the held edge"),
        (folded(1, -0.12, below=True), "folded over on the left"),
        (folded(1, 0.12, below=False), "folded over on the right"),
        (corner(free=True, left=True), "folded over at the left corner of the free edge"),
        (corner(free=False, left=False), "folded over at the right corner of the held edge"),
        (raised(slice(-2, None)), "in the air at the held edge"),
        (SPEC.hanging_nodes(SPEC.corners_at(0.0, 0.5)).reshape(flat().shape), "in the air"),
        (wavy(), "wrinkled"),
        (flat() * np.nan, "the simulation has diverged"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_it_says_what_keeps_a_cloth_from_being_flat(nodes, words):
    assert describe_cloth(nodes) == words
    if np.isfinite(nodes).all():
        assert not ClothGeometry(SPEC).flat_area(nodes.reshape(-1, 3)) > FLAT_AREA or words == "wrinkled"


def test_a_verdict_agrees_with_the_task():
    assert judge(0.995, 0.99, True, flat()).words == "100 %, flat"
    verdict = judge(0.77, 0.82, False, folded(0, 0.06, below=True))
    assert (verdict.words, verdict.success) == ("77 %, folded over at the free edge", False)
    assert judge(0.36, 0.0, False, None).words == "36 %, not flat"
