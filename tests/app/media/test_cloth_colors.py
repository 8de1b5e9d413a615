"""Colors of the live views: contrasts, color blindness, pattern, contact and folds."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from layflat.app.media import cloth_colors as colors
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.registry import cloth_spec

# Machado, Oliveira and Fernandes (2009), severity 1, for linear RGB.
BLINDNESS = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(rgb: object, matrix: object) -> np.ndarray:
    """CIE L*a*b* of an sRGB color as it is seen with a kind of color blindness."""
    share = np.asarray(rgb, dtype=float) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    x, y, z = np.cbrt(np.maximum(TO_XYZ @ np.clip(np.asarray(matrix) @ linear, 0, 1) / (0.9505, 1.0, 1.089), 0.008856))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


SEEN = {
    "face": colors.FACE,
    "check": colors.FACE_CHECK,
    "reverse": colors.REVERSE,
    "resting face": colors.shaded(colors.FACE),
    "resting check": colors.shaded(colors.FACE_CHECK),
    "resting reverse": colors.shaded(colors.REVERSE),
    "table": colors.TABLE,
    "holder": colors.HOLDER,
}


@pytest.mark.parametrize("kind", BLINDNESS)
@pytest.mark.parametrize(("a", "b"), list(combinations(SEEN, 2)))
def test_colors_differ_also_for_color_blind_people(kind: str, a: str, b: str) -> None:
    difference = np.linalg.norm(lab(SEEN[a], BLINDNESS[kind]) - lab(SEEN[b], BLINDNESS[kind]))
    assert difference > 15, f"{a} and {b} differ by {difference:.0f} in L*a*b*"


def test_red_and_green_of_equal_lightness_would_fail() -> None:
    red, green = (190, 90, 60), (110, 125, 60)
    normal, seen = (np.linalg.norm(lab(red, m) - lab(green, m)) for m in map(BLINDNESS.get, ("none", "deuteranopia")))
    assert normal > 40
    assert seen < 15


@pytest.mark.parametrize("what", ["HOLDER", "ARM", "FACE", "FACE_CHECK", "REVERSE", "TARGET", "HAND", "FOLD"])
def test_all_that_moves_is_seen_against_the_table(what: str) -> None:
    assert colors.contrast(getattr(colors, what), colors.TABLE) >= 3.0


def test_contact_is_darker_by_luminance() -> None:
    for rgb in (colors.FACE, colors.FACE_CHECK, colors.REVERSE):
        assert colors.contrast(rgb, colors.shaded(rgb)) > 1.8


def test_contrast_is_that_of_wcag() -> None:
    assert colors.contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21.0)
    assert colors.contrast((119, 119, 119), (255, 255, 255)) == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("name", ["towel", "napkin"])
@pytest.mark.parametrize("subdivisions", [1, 2])
def test_the_face_is_checked_and_the_reverse_is_plain(name: str, subdivisions: int) -> None:
    spec = cloth_spec(name)
    paint = colors.ClothPaint(spec, subdivisions=subdivisions)
    mesh = MeshMaker(spec, subdivisions=subdivisions).mesh(spec.hanging_nodes(spec.corners_at(0.0, 0.5)))
    np.testing.assert_array_equal(paint.triangles, mesh.triangles)
    face, reverse = paint.colors(mesh.vertices)
    assert set(map(tuple, face)) == {colors.FACE, colors.FACE_CHECK}
    assert set(map(tuple, reverse)) == {colors.REVERSE}
    # One check is one cell of the nodes' grid.
    middle = mesh.vertices[paint.triangles].mean(axis=1)
    top = spec.corners_at(0.0, 0.5)[0]
    row = ((0.5 - middle[:, 2]) / spec.length_m * (spec.rows - 1)).astype(int)
    column = ((top[1] - middle[:, 1]) / spec.held_width_m * (spec.columns - 1)).astype(int)
    parity = (spec.rows - 2 - row + column) % 2 == 1
    np.testing.assert_array_equal(paint.checked, parity)


def test_cloth_on_the_table_is_shaded_and_hanging_cloth_is_not() -> None:
    spec = cloth_spec("towel")
    paint, maker = colors.ClothPaint(spec), MeshMaker(spec)
    nodes = spec.flat_nodes()
    assert paint.resting(maker.mesh(nodes).vertices).all()
    nodes[spec.rows // 2 * spec.columns :, 2] += 0.05
    rests = paint.resting(maker.mesh(nodes).vertices)
    assert 0.4 < rests.mean() < 0.55
    assert not paint.resting(maker.mesh(spec.hanging_nodes(spec.corners_at(0.0, 0.5))).vertices).any()


def folded(at_m: float) -> tuple[np.ndarray, float]:
    """Nodes of a towel whose free part, as long as ``at_m``, is turned over onto the rest."""
    spec = cloth_spec("towel")
    nodes = spec.flat_nodes()
    turned = nodes[:, 0] < at_m
    nodes[turned, 0] = 2 * at_m - nodes[turned, 0]
    nodes[turned, 2] += 2 * spec.margin_m
    return nodes, at_m


def test_a_fold_has_a_line_where_it_turns() -> None:
    spec = cloth_spec("towel")
    paint, maker = colors.ClothPaint(spec), MeshMaker(spec)
    nodes, at_m = folded(0.1)
    lines = paint.fold_lines(maker.mesh(nodes))
    assert len(lines) >= spec.columns - 1
    assert np.abs(lines[..., 0] - at_m).max() < 0.03
    assert np.ptp(lines[..., 1]) == pytest.approx(spec.width_m, abs=0.01)


def test_flat_and_hanging_cloth_has_no_fold_line() -> None:
    spec = cloth_spec("towel")
    paint, maker = colors.ClothPaint(spec), MeshMaker(spec)
    hanging = spec.hanging_nodes(spec.corners_at(0.0, 0.5))
    hanging[:, 0] += 0.02 * np.sin(40 * hanging[:, 2])
    for nodes in (spec.flat_nodes(), hanging):
        assert paint.fold_lines(maker.mesh(nodes)).shape == (0, 2, 3)
