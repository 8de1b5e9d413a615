"""What every physics engine has to do behind the seam."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.physics.base import GRAVITY_M_S2, World
from layflat.sim.physics.registry import PHYSICS, make_world
from layflat.sim.robots.hanger import PandaHanger
from layflat.tests.sim.helpers import run, small_cloth

SMALL = small_cloth()


@pytest.fixture(params=PHYSICS)
def world(request: pytest.FixtureRequest) -> Iterator[World]:
    made = make_world(request.param, substep_s=1 / 240)
    yield made
    made.close()


def test_a_cloth_falls_by_gravity_and_comes_to_rest_on_the_table(world: World) -> None:
    cloth = world.add_cloth(SMALL, SMALL.flat_nodes(z_m=0.1))
    run(world, 24)
    assert 0.1 - cloth.nodes()[:, 2].mean() == pytest.approx(0.5 * GRAVITY_M_S2 * 0.1**2, rel=0.1)
    run(world, 120)
    assert cloth.flat_area(cloth.nodes()) == pytest.approx(1.0, abs=0.02)
    assert cloth.contact_portion_true(cloth.nodes()) == 1.0
    assert not cloth.nodes().flags.writeable


def test_wind_accelerates_the_cloth(world: World) -> None:
    cloth = world.add_cloth(SMALL, SMALL.flat_nodes(z_m=1.0))
    before = cloth.nodes().mean(axis=0)
    world.set_wind((0.0, 2.0, 0.0))
    run(world, 48)
    world.set_wind(None)
    assert cloth.nodes().mean(axis=0)[1] - before[1] == pytest.approx(0.5 * 2.0 * 0.2**2, rel=0.05)
    assert world.gravity_m_s2[1] == 0.0


def test_holders_carry_their_nodes_until_they_release_them(world: World) -> None:
    corners = SMALL.corners_at(0.0, 0.5)
    cloth = world.add_cloth(SMALL, SMALL.hanging_nodes(corners / np.array([1.0, 1.03, 1.0])))
    at = cloth.nodes()[list(SMALL.corners)]
    holders = world.add_holders(at)
    holders.grasp(cloth, SMALL.corners)
    for _ in range(48):
        at = at + np.array([0.001, 0.0, 0.0])
        holders.move(at.tolist(), [[0.24, 0.0, 0.0]] * 2)
        world.step()
    np.testing.assert_allclose(cloth.nodes()[list(SMALL.corners)], at, atol=0.003)
    holders.release()
    run(world, 24)
    assert cloth.nodes()[list(SMALL.corners), 2].max() < at[0, 2] - 0.01


def test_force_anchors_pull_their_node_and_count_the_impulse(world: World) -> None:
    cloth = world.add_cloth(SMALL, SMALL.flat_nodes())
    hands = world.add_force_anchors(cloth, [24], 0.1)
    for _ in range(24):
        hands.pull(hands.start + np.array([0.0, 0.0, 0.1]), np.zeros(3))
        world.step()
    assert 0 < hands.impulse_n_s()[2] <= 0.1 * 0.1 * 1.01
    assert cloth.nodes()[24, 2] > SMALL.margin_m + 0.005
    assert hands.positions().shape == (1, 3)
    hands.release()


def test_an_arm_reaches_its_pose_holds_nodes_and_is_drawn(world: World) -> None:
    spec = cloth_spec("napkin")
    assert not world.solids
    arm = PandaHanger.add_arm(world, spec)
    centre = np.array([0.2, 0.0, 0.4])
    arm.reset_joints(PandaHanger.joint_angles_at(centre, spec))
    place, rotation = arm.tool_pose()
    np.testing.assert_allclose(place, centre, atol=1e-6)
    np.testing.assert_allclose(rotation, np.diag([1, -1, -1]), atol=1e-6)
    angles, speeds = arm.joint_states()
    linear, angular, inertia, bias = arm.dynamics(angles, speeds)
    assert (np.shape(linear), np.shape(angular), inertia.shape, len(bias)) == ((3, 7), (3, 7), (7, 7), 7)
    assert np.linalg.eigvalsh(inertia).min() > 0
    arm.set_torques(np.array(bias))
    world.step()
    assert np.abs(np.array(arm.joint_states()[1])).max() < 0.05  # gravity is balanced
    vertices, triangles, colours = world.solids[0].mesh()
    assert len(triangles) == len(colours) > 1000
    assert vertices[:, 2].max() > 0.6 > 0.4 == pytest.approx(vertices[np.abs(vertices[:, 1]) < 0.2, 2].min(), abs=0.01)
