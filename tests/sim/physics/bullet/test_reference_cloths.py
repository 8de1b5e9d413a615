"""Published settingss: the cloth that their sources describe, and worlds that do not disturb each other."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.physics.bullet.reference_cloths import HANG_LENGTHS, SOLVER_SETTINGS, layflat_cloth, reference_cloth


@pytest.mark.parametrize("name", SOLVER_SETTINGS)
def test_a_flat_cloth_keeps_its_size_and_comes_to_rest_on_the_table(name: str) -> None:
    settings = SOLVER_SETTINGS[name]
    world = reference_cloth(settings, 5, "flat")
    for _ in range(round(0.4 * settings.rate_hz)):
        world.step()
    nodes = world.nodes()
    world.close()
    assert nodes.shape == (25, 3)
    np.testing.assert_allclose(np.ptp(nodes[:, :2], axis=0), settings.length_m, rtol=0.02)
    assert np.ptp(nodes[:, 2]) < 0.002
    assert -0.002 < nodes[:, 2].min() < 0.05


@pytest.mark.parametrize("name", SOLVER_SETTINGS)
def test_a_held_cloth_hangs_from_its_corners(name: str) -> None:
    settings = SOLVER_SETTINGS[name]
    world = reference_cloth(settings, 5, "held")
    for _ in range(round(0.3 * settings.rate_hz)):
        world.step()
    nodes = world.nodes()
    world.close()
    np.testing.assert_allclose(nodes[[20, 24], 2], HANG_LENGTHS * settings.length_m, atol=0.01 * settings.length_m)
    assert 0 < nodes[:, 2].min() < (HANG_LENGTHS - 0.9) * settings.length_m


def test_a_world_beside_it_changes_nothing() -> None:
    def fall(with_another: bool) -> np.ndarray:
        ours = layflat_cloth(CLOTHS["towel"], "held")
        other = reference_cloth(SOLVER_SETTINGS["DEDO"], 4, "flat") if with_another else None
        for _ in range(30):
            ours.step()
            if other is not None:
                other.step()
        nodes = ours.nodes().copy()
        ours.close()
        if other is not None:
            other.close()
        return nodes

    np.testing.assert_array_equal(fall(False), fall(True))
