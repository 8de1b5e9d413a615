"""A world for the tests of robots."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from layflat.sim.physics.bullet.world import BulletWorld
from layflat.tests.sim.helpers import bullet_world


@pytest.fixture
def world() -> Iterator[BulletWorld]:
    """Give an empty Bullet world."""
    with bullet_world() as made:
        yield made
