"""What every physics engine has to do behind the seam."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.errors import SimError
from layflat.sim.fabric import quality
from layflat.sim.physics.base import GRAVITY_M_S2, World
from layflat.sim.physics.hand_springs import HAND_MASS_KG
from layflat.sim.physics.registry import PHYSICS, is_installed, make_world, world_type
from layflat.sim.robots.hanger import PandaHanger
from layflat.tests.sim.helpers import fresh_process_outputs, run, simulation, small_cloth

SMALL = small_cloth()


INSTALLED = [name for name in PHYSICS if is_installed(name)]
each_engine = pytest.mark.parametrize("physics", INSTALLED)
FREE = (0.0, 0.0, 0.0)
PRESETS = ("towel", "napkin", "towel-fine")


@pytest.fixture(params=INSTALLED)
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


def test_velocities_are_the_change_of_the_nodes(world: World) -> None:
    cloth = world.add_cloth(SMALL, SMALL.flat_nodes(z_m=0.5))
    run(world, 12)
    before, velocities = cloth.nodes(), cloth.velocities()
    if velocities is None:
        pytest.skip("this engine does not show velocities")
    assert velocities[:, 2].mean() == pytest.approx(-GRAVITY_M_S2 * world.time_s, rel=0.02)
    run(world, 1)
    moved = (cloth.nodes() - before) / world.substep_s
    np.testing.assert_allclose(moved, 0.5 * (velocities + cloth.velocities()), atol=0.03)  # type: ignore[operator]


@pytest.mark.parametrize("nodes", [[24], [16, 17, 23, 24]])
def test_the_momentum_of_a_force_is_force_times_time(world: World, nodes: list[int]) -> None:
    """A hand of 0.1 N for 0.2 s sideways on a cloth in free flight; it counts what it gave."""
    cloth = world.add_cloth(SMALL, SMALL.flat_nodes(z_m=1.0))
    world.set_gravity(FREE)
    hands = world.add_force_anchors(cloth, nodes, 0.1)
    for _ in range(48):
        hands.pull(hands.positions() + np.array([0.0, 10.0, 0.0]), np.array([0.0, 10.0, 0.0]))
        world.step()
    given = hands.impulse_n_s()
    hands.release()
    before = cloth.nodes().mean(axis=0)
    run(world, 24)
    gained = SMALL.mass_kg * (cloth.nodes().mean(axis=0) - before) / (24 * world.substep_s)
    share = SMALL.mass_kg / (SMALL.mass_kg + len(nodes) * HAND_MASS_KG)  # the hands keep the rest
    assert given[1] == pytest.approx(0.1 * 0.2 * share, rel=0.15)
    # Bullet's implicit damping does not act back on anchored nodes.
    np.testing.assert_allclose(gained, given, atol=(0.12 if cloth.velocities() is None else 0.01) * given[1])


def test_friction_of_the_table_holds_or_lets_slide(world: World) -> None:
    """Sideways gravity of 0.3 g: below the friction of 0.5 * 1, above that of 0.5 * 0.2."""
    slide = type(world)(substep_s=world.substep_s, table_friction=0.2)
    moved = []
    for made in (world, slide):
        cloth = made.add_cloth(SMALL, SMALL.flat_nodes())
        run(made, 24)
        before = cloth.nodes()[:, 0].mean()
        made.set_gravity((0.3 * GRAVITY_M_S2, 0.0, -GRAVITY_M_S2))
        run(made, 96)
        moved.append(cloth.nodes()[:, 0].mean() - before)
    slide.close()
    assert abs(moved[0]) < 0.003
    assert moved[1] == pytest.approx(0.5 * (0.3 - 0.5 * 0.2) * GRAVITY_M_S2 * 0.4**2, rel=0.25)


def test_gravity_must_be_finite_and_wind_is_added(world: World) -> None:
    with pytest.raises(SimError, match="finite"):
        world.set_gravity((0.0, 0.0, float("nan")))
    world.set_wind((2.0, 0.0, 0.0))
    world.set_gravity((0.0, 1.0, -9.0))
    assert world.gravity_m_s2 == (2.0, 1.0, -9.0)
    world.set_wind(None)
    assert world.gravity_m_s2 == (0.0, 1.0, -9.0)


def test_an_arm_that_holds_cloth_stays_where_its_motors_keep_it(world: World) -> None:
    spec = cloth_spec("napkin")
    corners = spec.corners_at(0.2, 0.5) / np.array([1.0, 1.03, 1.0])
    cloth = world.add_cloth(spec, spec.hanging_nodes(corners))
    hanger = PandaHanger.add_arm(world, spec)
    angles = PandaHanger.joint_angles_at(corners.mean(axis=0), spec)
    hanger.reset_joints(angles)
    hanger.grasp(cloth, spec.corners)
    hanger.drive_joints(angles, np.zeros(7), np.full(7, 50.0))
    run(world, 48)
    np.testing.assert_allclose(hanger.joint_states()[0], angles, atol=1e-3)
    np.testing.assert_allclose(cloth.nodes()[list(spec.corners)], corners, atol=0.002)


def test_a_refined_step_is_shorter(world: World) -> None:
    cloth = world.add_cloth(SMALL, SMALL.flat_nodes(z_m=1.0))
    world.refine(2)
    run(world, 48)
    assert world.time_s == pytest.approx(0.1)
    assert 1.0 - cloth.nodes()[:, 2].mean() == pytest.approx(0.5 * GRAVITY_M_S2 * 0.1**2, rel=0.05)


def test_what_cannot_be_saved_is_refused(world: World) -> None:
    if world.saves_state:
        pytest.skip("this engine saves its state")
    for call in (world.save, lambda: world.restore(None)):
        with pytest.raises(SimError, match="fork"):
            call()


@each_engine
@pytest.mark.parametrize("preset", PRESETS)
def test_the_fabric_is_good(physics: str, preset: str) -> None:
    """It stretches by 0.2 to 2 % and sags by 10 mm at most, rests on the table, folds without diverging."""
    spec = cloth_spec(preset)
    assert 0.002 < quality.hanging_stretch(spec, physics) < 0.02
    assert quality.hem_sag_m(spec, physics) < quality.SAG_M
    penetration, above = quality.fall(spec, physics)
    assert penetration < 0.0018  # 1.65 mm of towel-fine in Bullet
    assert above < quality.REST_M
    assert quality.fold(spec, physics) is None


REPEAT = """
import sys, hashlib
from layflat.tests.sim.helpers import simulation
with simulation(sys.argv[1], 3, physics=sys.argv[2]) as sim:
    sim.disturb("thesis")
    for k in range(12):
        sim.step(sim.spec.robot.zeros() + 0.004 * (-1) ** k)
    print(hashlib.sha256(sim.ground_truth().nodes.tobytes()).hexdigest())
"""


@each_engine
def test_a_fresh_process_repeats_to_the_bit(physics: str) -> None:
    outputs = fresh_process_outputs(REPEAT, *([robot, physics] for robot in ("hanger", "pickers") for _ in range(2)))
    assert outputs[0] == outputs[1] != outputs[2] == outputs[3]


@each_engine
@pytest.mark.parametrize("robot", ["pickers", "hanger"])
def test_a_restored_simulation_goes_on_to_the_bit(physics: str, robot: str) -> None:
    """In the middle of a disturbance; also from another compiled model, after the hands have let go."""
    if not world_type(physics).saves_state:
        pytest.skip("this engine cannot save its state")
    move = 0.004
    with simulation(robot, 5, physics=physics, camera=True) as sim:
        sim.disturb("lift-drop")
        for _ in range(3):
            sim.step(sim.spec.robot.zeros() - move)
        saved = sim.save()
        runs = []
        for steps in (4, 30, 4):
            sim.restore(saved)
            for _ in range(4):
                sim.step(sim.spec.robot.zeros() + move)
            seen = sim.observe()
            assert seen.depth is not None
            runs.append((sim.ground_truth().nodes.tobytes(), seen.depth.tobytes(), sim.time_s, sim.force_n().tobytes()))
            for _ in range(steps - 4):
                sim.step(sim.spec.robot.zeros())
        assert runs[0] == runs[1] == runs[2]


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
