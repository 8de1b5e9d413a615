"""Every physics engine by its name. A new one adds a folder and a function here."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping

from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError, look_up
from layflat.sim.physics.base import World

DEFAULT_PHYSICS = "bullet"


def _bullet() -> type[World]:
    from layflat.sim.physics.bullet.world import BulletWorld

    return BulletWorld


def _mujoco() -> type[World]:
    from layflat.sim.physics.mujoco.world import MujocoWorld

    return MujocoWorld


PHYSICS: Mapping[str, Callable[[], type[World]]] = {"bullet": _bullet, "mujoco": _mujoco}
"""Functions that import an engine, so that an engine is loaded only where it is used."""


MODULES: Mapping[str, str] = {"bullet": "pybullet", "mujoco": "mujoco"}
"""The package that each engine stands on."""
EXTRAS: Mapping[str, str] = {"mujoco": "pip install 'layflat[mujoco]' (Python 3.11 or newer)"}
"""How the optional ones are installed."""


def is_installed(name: str) -> bool:
    """Whether an engine can be used here."""
    return importlib.util.find_spec(MODULES[name]) is not None


def check_physics(name: str) -> None:
    """Raise SimError with the known names, or with what to install."""
    look_up("physics", name, PHYSICS)
    if not is_installed(name):
        advice = EXTRAS.get(name, "`layflat doctor` says what to do")
        raise SimError(f"physics {name} is not installed: {advice}")


def world_type(name: str) -> type[World]:
    """Return the worlds of an engine; SimError lists the known names, or says what to install."""
    check_physics(name)
    return PHYSICS[name]()


def make_world(name: str = DEFAULT_PHYSICS, *, substep_s: float, table_friction: float = 1.0) -> World:
    """Make an empty world of the engine of that name; SimError lists the known names."""
    return world_type(name)(substep_s=substep_s, table_friction=table_friction)


def cloth_world(name: str, cloth: ClothSpec, *, table_friction: float = 1.0) -> World:
    """Make an empty world with the substep that its engine uses for a cloth."""
    rate_hz = world_type(name).rate_hz(cloth)
    return make_world(name, substep_s=1.0 / rate_hz, table_friction=table_friction)
