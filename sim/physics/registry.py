"""Every physics engine by its name. A new one adds a folder and a function here."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from layflat.sim.errors import look_up
from layflat.sim.physics.base import World

DEFAULT_PHYSICS = "bullet"


def _bullet() -> type[World]:
    from layflat.sim.physics.bullet.world import BulletWorld

    return BulletWorld


PHYSICS: Mapping[str, Callable[[], type[World]]] = {"bullet": _bullet}
"""Functions that import an engine, so that an engine is loaded only where it is used."""


def make_world(name: str = DEFAULT_PHYSICS, *, substep_s: float, table_friction: float = 1.0) -> World:
    """Make an empty world of the engine of that name; SimError lists the known names."""
    return look_up("physics", name, PHYSICS)()(substep_s=substep_s, table_friction=table_friction)
