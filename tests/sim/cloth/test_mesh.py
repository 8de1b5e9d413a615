"""The surface that is drawn through the cloth's nodes."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.registry import cloth_spec

SPEC = cloth_spec("napkin")


def _surface(height: np.ndarray) -> np.ndarray:
    nodes = SPEC.flat_nodes()
    nodes[:, 2] = height
    return nodes


@pytest.mark.parametrize("subdivisions", [1, 2, 3])
def test_every_node_is_a_vertex(subdivisions: int) -> None:
    nodes = _surface(np.random.default_rng(0).uniform(0.01, 0.05, SPEC.rows * SPEC.columns))
    mesh = MeshMaker(SPEC, subdivisions=subdivisions).mesh(nodes)
    fine = mesh.vertices.reshape((SPEC.rows - 1) * subdivisions + 1, (SPEC.columns - 1) * subdivisions + 1, 3)
    np.testing.assert_allclose(fine[::subdivisions, ::subdivisions].reshape(-1, 3), nodes, atol=1e-12)


def test_a_plane_stays_a_plane_with_its_normal() -> None:
    flat = SPEC.flat_nodes()
    mesh = MeshMaker(SPEC).mesh(_surface(0.05 + 0.2 * flat[:, 0] - 0.1 * flat[:, 1]))
    x, y, z = mesh.vertices.T
    np.testing.assert_allclose(z, 0.05 + 0.2 * x - 0.1 * y, atol=1e-12)
    up = np.array([-0.2, 0.1, 1.0])
    np.testing.assert_allclose(mesh.normals, np.tile(up / np.linalg.norm(up), (len(x), 1)), atol=1e-9)


def test_the_curve_is_nearer_to_a_wave_than_straight_edges() -> None:
    wave_m = 0.12
    x = SPEC.flat_nodes()[:, 0]
    fine = MeshMaker(SPEC).mesh(_surface(0.03 + 0.01 * np.sin(2 * np.pi * x / wave_m))).vertices
    profile = fine.reshape(2 * SPEC.rows - 1, -1, 3)[2:-2, 0]
    nodes, between = profile[::2], profile[1::2]
    ground_truth = 0.03 + 0.01 * np.sin(2 * np.pi * between[:, 0] / wave_m)
    straight = 0.5 * (nodes[:-1, 2] + nodes[1:, 2])
    assert np.abs(between[:, 2] - ground_truth).max() < 0.4 * np.abs(straight - ground_truth).max()


def test_triangles_face_the_way_the_normals_point_and_have_the_clothes_area() -> None:
    mesh = MeshMaker(SPEC).mesh(SPEC.flat_nodes())
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    double = np.cross(b - a, c - a)
    assert (double[:, 2] > 0).all()
    assert (mesh.normals[:, 2] > 0.999).all()
    assert double[:, 2].sum() / 2 == pytest.approx(SPEC.length_m * SPEC.width_m)


def test_nothing_dips_into_the_table_and_nodes_that_sank_into_it_are_drawn_on_it() -> None:
    half_lifted = np.where(np.arange(SPEC.n_nodes) // SPEC.columns < SPEC.rows // 2, 0.004, 0.08)
    for height in (half_lifted, np.random.default_rng(1).uniform(-0.008, 0.002, SPEC.n_nodes)):
        assert MeshMaker(SPEC).mesh(_surface(height)).vertices[:, 2].min() > 0


def test_a_cloth_that_hangs_over_the_edge_stays_below_it() -> None:
    flat = SPEC.flat_nodes()
    over = flat[:, 0] > 0.15
    nodes = flat.copy()
    nodes[over, 0] = 0.15
    nodes[:, 2] = np.where(over, 0.15 - flat[:, 0], 0.004)
    vertices = MeshMaker(SPEC).mesh(nodes).vertices
    assert vertices[:, 2].min() == pytest.approx(nodes[:, 2].min(), abs=1e-9)
