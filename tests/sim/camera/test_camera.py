"""The RGB-D camera against geometry, TinyRenderer and the eye's needs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import pybullet as bullet
import pytest

from layflat.perception.arrays import touches_border
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.sim.camera.camera import Camera, default_pinhole
from layflat.sim.camera.renderer import LIGHT, Renderer
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.robots.arm_shape import _BOX_CORNERS, _BOX_TRIANGLES
from layflat.tests.sim.camera.tiny_renderer import TinyRenderer
from layflat.tests.sim.helpers import bullet_world, cloth_in_world

SPEC = cloth_spec("towel")


@pytest.fixture
def cloth() -> Iterator[BulletCloth]:
    """Give a flat cloth on the table."""
    with cloth_in_world(SPEC, SPEC.flat_nodes()) as made:
        yield made


@pytest.fixture
def camera(cloth: BulletCloth) -> Camera:
    """Give a camera without noise that sees it."""
    return Camera(cloth, noise=None, seed=0)


def _is_blue(rgb: np.ndarray, least: int = 60) -> np.ndarray:
    return rgb[..., 2].astype(int) - rgb[..., 0] > least


class Box:
    """A solid box."""

    def __init__(self, at: Sequence[float], half: Sequence[float], rotation: np.ndarray | None = None) -> None:
        self.at, self.half = np.array(at), np.array(half)
        self.rotation = np.eye(3) if rotation is None else rotation

    def mesh(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        vertices = 2 * self.half * _BOX_CORNERS @ self.rotation.T + self.at
        return vertices, _BOX_TRIANGLES, np.full((12, 3), (20.0, 200.0, 20.0))


def _wavy(direction_deg: float) -> np.ndarray:
    nodes = SPEC.flat_nodes()
    along = nodes[:, :2] @ [np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg))]
    nodes[:, 2] += 0.008 * (1 + np.sin(2 * np.pi * along / 0.1))
    return nodes


def test_tiny_renderer_draws_the_same_box() -> None:
    half, at, colour = np.array([0.12, 0.09, 0.05]), np.array([0.25, 0.0, 0.25]), (20 / 255, 200 / 255, 20 / 255, 1)
    turn = bullet.getQuaternionFromEuler((0.5, 0.4, 0.7))
    box = Box(at.tolist(), half.tolist(), np.array(bullet.getMatrixFromQuaternion(turn)).reshape(3, 3))
    # An unequal, off-centre pinhole, so that a swapped or shifted axis shows.
    pose = default_pinhole().cam_to_world
    view = Renderer(PinholeCamera(width=320, height=240, fx=307, fy=290, cx=150.3, cy=125.7, cam_to_world=pose))
    ours = view.background()
    ours.depth[:] = np.inf
    view.draw_solid(ours, *box.mesh())
    with bullet_world() as world:
        bullet.removeBody(0, physicsClientId=world.client)  # the table
        shape = {"halfExtents": half.tolist(), "rgbaColor": colour, "physicsClientId": world.client}
        visual = bullet.createVisualShape(bullet.GEOM_BOX, **shape)
        where = {"basePosition": at.tolist(), "baseOrientation": turn, "physicsClientId": world.client}
        bullet.createMultiBody(0, -1, visual, **where)
        pixels, depth, rgb = TinyRenderer(world.client, view.pinhole, LIGHT).draw()
    drawn = np.flatnonzero(np.isfinite(ours.depth))
    assert len(drawn) > 2000
    assert len(np.setxor1d(drawn, pixels)) < 0.005 * len(drawn)
    both, _, second = np.intersect1d(drawn, pixels, return_indices=True)
    assert np.abs(ours.depth[both] - depth[second]).max() < 2e-4
    # Its highlights, which ours has not, are a few levels.
    assert np.abs(ours.rgb[both].astype(int) - rgb[second]).max() < 16


def test_flat_cloth_fills_its_projected_outline(camera: Camera) -> None:
    rgb, _ = camera.capture()
    corners, _ = camera.pinhole.project(SPEC.flat_nodes()[[0, SPEC.columns - 1, -1, -SPEC.columns]])
    area = cv2.contourArea(corners.astype(np.float32))
    blue = _is_blue(rgb)
    assert blue.sum() == pytest.approx(area, rel=0.02)


def test_depth_gives_the_height_of_what_is_seen(camera: Camera) -> None:
    rgb, depth = camera.capture()
    assert depth.dtype == np.float32
    assert rgb.dtype == np.uint8
    height = camera.pinhole.height_above_table(depth)
    on_cloth = _is_blue(rgb)
    np.testing.assert_allclose(height[on_cloth], SPEC.margin_m, atol=2e-4)
    table = ~on_cloth & (np.abs(height) < 0.3)
    np.testing.assert_allclose(height[table], 0.0, atol=2e-4)
    assert table.mean() > 0.5


def test_the_region_where_cloth_goes_is_in_the_image() -> None:
    pinhole = default_pinhole()
    region = np.array([[x, y, 0.0] for x in (-0.15, 0.75) for y in (-0.25, 0.25)])
    pixels, depth = pinhole.project(region)
    assert (depth > 0).all()
    assert (pixels >= 0).all()
    assert (pixels <= [pinhole.width - 1, pinhole.height - 1]).all()


@pytest.mark.parametrize("direction_deg", [0, 30, 60, 90])
def test_wrinkles_of_these_directions_are_shaded(camera: Camera, direction_deg: float) -> None:

    def contrast(nodes: np.ndarray) -> float:
        rgb, _ = camera.capture(nodes)
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        inside = cv2.erode(_is_blue(rgb, 40).astype(np.uint8), np.ones((7, 7))) > 0
        return float(grey[inside].std())

    assert contrast(_wavy(direction_deg)) > 8 > 1 > contrast(SPEC.flat_nodes())


def test_one_range_of_hue_takes_face_reverse_and_shade(camera: Camera) -> None:
    reverse = SPEC.flat_nodes()
    reverse[:, 1] *= -1
    counts = [segment(camera.capture(nodes)[0], HsvRange()).sum() for nodes in (SPEC.flat_nodes(), reverse)]
    assert counts[0] == pytest.approx(counts[1], rel=0.01)
    face, back = (camera.capture(nodes)[0] for nodes in (SPEC.flat_nodes(), reverse))
    assert np.abs(face.astype(int) - back).max() > 10
    wavy, depth = camera.capture(_wavy(45))
    on_cloth = (camera.pinhole.height_above_table(depth) > 0.002) & (depth < 1.3)
    assert segment(wavy, HsvRange())[on_cloth].mean() > 0.97


def test_same_seed_same_frames_bit_for_bit(cloth: BulletCloth) -> None:
    first, second = (Camera(cloth, seed=3) for _ in range(2))
    for _ in range(2):
        (rgb_a, depth_a), (rgb_b, depth_b) = first.capture(), second.capture()
        assert rgb_a.tobytes() == rgb_b.tobytes()
        assert depth_a.tobytes() == depth_b.tobytes()
    assert Camera(cloth, seed=4).capture()[1].tobytes() != depth_a.tobytes()


def _hidden_share(camera: Camera, nodes: np.ndarray) -> float:
    """Return the share of the pixels of a cloth at ``nodes`` that a body hides, 0..1."""
    mesh = camera._meshes.mesh(nodes)
    raster = camera._renderer.raster(mesh.vertices, mesh.triangles)
    picture = camera._renderer.background()
    picture.depth[:] = np.inf
    for solid in camera._world.solids:
        camera._renderer.draw_solid(picture, *solid.mesh())
    return float((picture.depth[raster.pixels] < raster.depth).mean())


def test_a_body_in_front_hides_and_one_beneath_does_not(cloth: BulletCloth, camera: Camera) -> None:
    assert _hidden_share(camera, SPEC.flat_nodes()) == 0.0
    board = Box([0.175, 0, -0.02], [0.3, 0.3, 0.01])
    cloth.world.solids.append(board)
    assert _hidden_share(camera, SPEC.flat_nodes()) == 0.0
    board.at = np.array([0.175, 0.0, 0.05])
    assert _hidden_share(camera, SPEC.flat_nodes()) > 0.95
    rgb, _ = camera.capture()
    assert segment(rgb, HsvRange()).sum() == 0


def test_pictures_for_people(cloth: BulletCloth) -> None:
    camera = Camera(cloth, seed=0)
    hanging = SPEC.hanging_nodes(np.array([[0.0, 0.18, 0.45], [0.0, -0.18, 0.45]]))
    for nodes in (SPEC.flat_nodes(), hanging):
        picture = camera.render(160, 120, nodes=nodes)
        assert picture.shape == (120, 160, 3)
        mask = segment(picture, HsvRange())
        assert mask.sum() > 300
        assert not touches_border(mask)
    with_marker = camera.render(160, 120, nodes=hanging, markers=np.array([[0.4, 0.0, 0.1]]))
    assert 0 < (with_marker != picture).any(axis=2).sum() < 60


def test_memory_does_not_grow_with_the_frames(cloth: BulletCloth) -> None:
    cloth.world.solids.append(Box([0.5, 0, 0.2], [0.02] * 3))
    camera = Camera(cloth, seed=0, pinhole=default_pinhole(width=80, height=60))
    statm = Path("/proc/self/statm")
    if not statm.exists():
        pytest.skip("resident memory is read from /proc")

    def resident_kb() -> float:
        return int(statm.read_text().split()[1]) * 4.0

    for _ in range(30):
        camera.capture()
    before, end = resident_kb(), time.monotonic() + 1.0
    frames = 0
    while time.monotonic() < end or frames < 60:
        camera.capture()
        frames += 1
    # TinyRenderer keeps 195 kB of a mesh body that is shown and removed for each frame.
    assert (resident_kb() - before) / frames < 10
