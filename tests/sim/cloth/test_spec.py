"""Cloth specs: their mesh and the presets' rules."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.cloth.cloth_file import read_cloth
from layflat.sim.cloth.registry import CLOTHS, PRESETS, cloth_spec
from layflat.sim.errors import SimError
from layflat.tests.sim.helpers import small_cloth

SMALL = small_cloth(0.2, 6, 5, width_m=0.16)


def test_triangles_tile_the_cloth_face_up_with_its_held_corners_at_the_far_edge() -> None:
    corners = SMALL.flat_nodes()[SMALL.triangles()]
    normals = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() == pytest.approx(SMALL.length_m * SMALL.width_m)
    assert len(np.unique(SMALL.triangles())) == SMALL.rows * SMALL.columns
    np.testing.assert_allclose(SMALL.flat_nodes()[[*SMALL.corners]], [[0.2, 0.08, 0.004], [0.2, -0.08, 0.004]])


def test_presets_keep_the_rules() -> None:
    for name, spec in CLOTHS.items():
        assert spec.name == name
        # No coarser than the default cloth, which has at least 13 x 13 nodes; a larger one has more of them.
        coarsest = 0.030 if max(spec.length_m, spec.width_m) <= 0.35 else 0.0321
        assert spec.length_m / (spec.rows - 1) < coarsest
        assert spec.width_m / (spec.columns - 1) < coarsest
        assert spec.damping_n_s_m > spec.elastic_n_m / spec.rate_hz / 2
    assert min(CLOTHS["towel"].rows, CLOTHS["towel"].columns) >= 13
    assert min(CLOTHS["towel-fine"].rows, CLOTHS["towel-fine"].columns) >= 16
    assert (CLOTHS["towel"].length_m, CLOTHS["towel"].width_m) == (0.35, 0.35)  # cloth 1 of chapter 3-3-1
    assert sorted((CLOTHS["napkin"].length_m, CLOTHS["napkin"].width_m)) == [0.215, 0.275]  # cloth 2


def test_ten_cloths_and_five_fabrics_of_all_sizes_have_a_name() -> None:
    sizes = {(spec.length_m, spec.width_m) for spec in CLOTHS.values()}
    assert min(map(min, sizes)) <= 0.20
    assert max(map(min, sizes)) >= 0.50
    assert len([name for name in CLOTHS if name != "towel-fine"]) >= 10
    fabrics = ("silk-scarf", "dish-towel", "linen", "denim", "terry")
    bending = {read_cloth(PRESETS / f"{name}.toml").bending_length_m for name in fabrics}
    assert len(bending) == 5
    assert min(bending) < 0.014
    assert max(bending) > 0.03


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"damping_n_s_m": 0.05}, "explodes"), ({"mass_kg": 0.0}, "mass_kg"), ({"rows": 1}, "at least 2 x 2")],
)
def test_impossible_cloths_are_refused(wrong: dict[str, float], said: str) -> None:
    with pytest.raises(SimError, match=said):
        cloth_spec("towel", **wrong)
    with pytest.raises(SimError, match=r"towel, napkin, towel-fine"):
        cloth_spec("silk")
