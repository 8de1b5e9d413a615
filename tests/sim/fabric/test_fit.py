"""What the two tests of a fabric measure, and the springs that give it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from layflat.sim.cloth.cloth_file import ClothFile
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.errors import SimError
from layflat.sim.fabric import quality
from layflat.sim.fabric.fit import fit_cloth, grid

TEA = ClothFile(name="tea", length_m=0.2, width_m=0.16, mass_kg=0.012, hanging_stretch=0.012, bending_length_m=0.018)


def test_a_cloth_of_twice_the_weight_stretches_twice_as_far():
    spec = CLOTHS["napkin"]
    once, twice = (quality.hanging_stretch(replace(spec, mass_kg=k * spec.mass_kg, rate_hz=240.0)) for k in (1, 2))
    assert once == pytest.approx(0.011, abs=0.002)
    assert twice == pytest.approx(2 * once, rel=0.2)


def test_stiffer_bending_springs_give_a_longer_overhang():
    spec = CLOTHS["napkin"]
    lengths = [quality.bending_length_m(replace(spec, bending_n_m=stiff)) for stiff in (0.03, 0.5, 4.0)]
    assert lengths == sorted(lengths)
    assert lengths[2] > 1.8 * lengths[0]


def test_a_cloth_that_diverges_is_found():
    wrong = replace(CLOTHS["napkin"], bending_n_m=120.0)
    with pytest.raises(SimError, match="diverges while it hangs"):
        quality.hanging_stretch(wrong)


@pytest.mark.parametrize("size", [(0.15, 0.15), (0.15, 0.6), (0.35, 0.35), (0.6, 0.6)])
def test_every_size_has_enough_nodes_and_not_too_many(size):
    rows, columns = grid(*size)
    assert rows * columns <= 400
    assert min(rows, columns) >= 5
    assert size[0] / (rows - 1) == pytest.approx(size[1] / (columns - 1), rel=0.2)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_fitted_cloth_is_the_fabric():
    _, measured = fit_cloth(TEA)
    assert measured.problems == ()
    assert measured.hanging_stretch == pytest.approx(0.012, abs=0.01)
    assert measured.bending_length_m == pytest.approx(0.018, rel=0.2)


def test_a_fabric_that_no_rate_holds_is_refused_with_the_limit():
    with pytest.raises(SimError, match=r"would need \d+ physics steps a second, at most 600 .* hanging_stretch"):
        fit_cloth(replace(TEA, length_m=0.6, width_m=0.6, mass_kg=0.9, hanging_stretch=0.001))
