"""Simulations from names that a user gives."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from layflat.app.support.errors import UsageError
from layflat.app.support.validators import one_of
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError
from layflat.sim.physics.registry import PHYSICS
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.starts.registry import STARTS
from layflat.sim.tasks import TASKS

REGISTRIES: Mapping[str, Collection[str]] = {
    "robot": ROBOTS,
    "task": TASKS,
    "physics": PHYSICS,
    "start": STARTS,
    "descriptor": DESCRIPTORS,
}
"""Known names of the settings of a simulation that are names."""


def sim_config(**settings: Any) -> SimConfig:
    """Return the simulation with these settings; UsageError where a name is unknown or they do not go together."""
    for kind, value in settings.items():
        if kind in REGISTRIES and value is not None:
            _check_name(kind, value)
    try:
        return SimConfig(**settings)
    except SimError as error:
        raise UsageError(str(error)) from None


def _check_name(kind: str, name: str) -> None:
    """Raise UsageError for an unknown name; one that belongs to another setting is said to."""
    try:
        one_of(kind, name, REGISTRIES[kind])
    except UsageError as error:
        other = next((other for other, names in REGISTRIES.items() if name in names), None)
        raise UsageError(f"{error}; {name} is a {other}: --{other} {name}" if other else str(error)) from None
