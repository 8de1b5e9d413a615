"""Published settingss: the cloth that their sources describe, and worlds that do not disturb each other."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.physics.bullet.reference_cloths import (
    HANG_LENGTHS,
    SOLVER_SETTINGS,
    Situation,
    layflat_cloth,
    reference_cloth,
)


def _after(name: str, situation: Situation, duration_s: float) -> np.ndarray:
    settings = SOLVER_SETTINGS[name]
    cloth = reference_cloth(settings, 5, situation)
    for _ in range(round(duration_s * settings.rate_hz)):
        cloth.step()
    nodes = cloth.nodes()
    cloth.close()
    return nodes


@pytest.mark.parametrize("name", SOLVER_SETTINGS)
def test_a_flat_cloth_keeps_its_size_and_rests_on_the_table_and_a_held_one_hangs_from_its_corners(name: str) -> None:
    length_m, flat = SOLVER_SETTINGS[name].length_m, _after(name, "flat", 0.4)
    assert flat.shape == (25, 3)
    np.testing.assert_allclose(np.ptp(flat[:, :2], axis=0), length_m, rtol=0.02)
    assert np.ptp(flat[:, 2]) < 0.002
    assert -0.002 < flat[:, 2].min() < 0.05
    held = _after(name, "held", 0.3)
    np.testing.assert_allclose(held[[20, 24], 2], HANG_LENGTHS * length_m, atol=0.01 * length_m)
    assert 0 < held[:, 2].min() < (HANG_LENGTHS - 0.9) * length_m


def test_a_world_beside_it_changes_nothing() -> None:
    results = []
    for beside in (0, 1):
        cloths = [layflat_cloth(CLOTHS["towel"], "held")]
        cloths += [reference_cloth(SOLVER_SETTINGS["DEDO"], 4, "flat")] * beside
        for _ in range(30):
            for cloth in cloths:
                cloth.step()
        results.append(cloths[0].nodes())
        for cloth in cloths:
            cloth.close()
    np.testing.assert_array_equal(*results)
