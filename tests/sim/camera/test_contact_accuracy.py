"""The camera's contact portion against the mesh's, on rendered cloth with sensor noise; whole placements are slow."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.sim.camera.camera import Camera
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.tests.sim.helpers import cloth_in_world

LAID = (0.15, 0.4, 0.65, 0.9)


class View:
    """A cloth that is put where it should be, and a camera that knows its P_flat; nothing is simulated."""

    def __init__(self, cloth: BulletCloth) -> None:
        self.cloth, self.spec = cloth, cloth.spec
        self.camera = Camera(cloth, seed=0)
        blank = PerceptionPipeline(self.camera.pinhole)
        flat = blank.perceive(*self.camera.capture(self.spec.flat_nodes()))
        self.perceiver = blank.with_flat_pixels(flat.cloth_pixels)

    def errors(self, nodes: np.ndarray, frames: int = 3) -> np.ndarray:
        """Return the contact portion of the camera minus that of the mesh, (frames,)."""
        seen = [self.perceiver.perceive(*self.camera.capture(nodes)).contact_portion for _ in range(frames)]
        return np.array(seen) - self.cloth.contact_portion_true(nodes)


@pytest.fixture(scope="module", params=["towel", "napkin"])
def view(request: pytest.FixtureRequest) -> Iterator[View]:
    with cloth_in_world(cloth_spec(request.param)) as cloth:
        yield View(cloth)


def laid(spec: ClothSpec, share: float, *, stretch: float = 1.0, radius_m: float = 0.06) -> np.ndarray:
    """Nodes of a cloth that lies up to ``share`` of its length and rises from there on a circle, then straight up."""
    flat = spec.flat_nodes(z_m=0.002)
    along = np.maximum(flat[:, 0] - share * spec.length_m, 0.0) * stretch
    turn = np.minimum(along / radius_m, np.pi / 2)
    up = np.maximum(along - radius_m * np.pi / 2, 0.0)
    nodes = flat * [1.0, stretch, 1.0]
    nodes[:, 0] = np.minimum(flat[:, 0], share * spec.length_m) * stretch + radius_m * np.sin(turn)
    nodes[:, 2] += radius_m * (1 - np.cos(turn)) + up
    return nodes


@pytest.mark.parametrize("share", LAID)
def test_contact_of_a_half_laid_cloth(view: View, share: float) -> None:
    assert np.abs(view.errors(laid(view.spec, share))).max() < 0.015


@pytest.mark.parametrize("share", LAID)
def test_stretch_that_is_not_seen_is_all_that_is_wrong(view: View, share: float) -> None:
    """The limit: while part of the cloth hangs out of sight, how far it is stretched cannot be seen."""
    stretch = 1.025
    nodes = laid(view.spec, share, stretch=stretch)
    most = view.cloth.contact_portion_true(nodes) * (stretch**2 - 1)
    errors = view.errors(nodes)
    assert errors.min() > -0.015
    assert errors.max() < most + 0.015


@pytest.mark.parametrize("height_m", [-0.0007, 0.0005, 0.004])
@pytest.mark.parametrize("stretch", [(1.0, 1.0), (1.03, 1.02)])
def test_a_flat_cloth_is_all_contact(view: View, height_m: float, stretch: tuple[float, float]) -> None:
    """For any stretch, and any depth to which Bullet lets it sink."""
    nodes = view.spec.flat_nodes(z_m=height_m) * [*stretch, 1.0]
    assert np.abs(view.errors(nodes)).max() < 0.012


@pytest.mark.parametrize("stretch", [1.0, 1.02])
def test_a_wrinkle_of_a_taut_cloth_is_missed_contact(view: View, stretch: float) -> None:
    """A ridge 25 mm high across the cloth, as a drag that is too short leaves it: stretch does not fill it up."""
    nodes = view.spec.flat_nodes(z_m=0.002) * [stretch, stretch, 1.0]
    nodes[:, 2] += 0.025 * np.exp(-((nodes[:, 0] - 0.6 * view.spec.length_m) ** 2) / (2 * 0.025**2))
    assert view.cloth.contact_portion_true(nodes) < 0.85
    assert np.abs(view.errors(nodes)).mean() < 0.02


def test_a_part_below_a_fold_is_hidden(view: View) -> None:
    """The limit: what lies beneath a second layer is in contact, and no camera sees it."""
    nodes = view.spec.flat_nodes(z_m=0.004)
    crease = 0.7 * view.spec.length_m
    beyond = nodes[:, 0] > crease
    nodes[beyond, 0] = 2 * crease - nodes[beyond, 0]
    nodes[beyond, 2] += 2 * view.spec.margin_m
    assert view.errors(nodes).mean() == pytest.approx(-0.3, abs=0.06)
