"""Simulations from names that a user gives."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from layflat.app.support.errors import UsageError
from layflat.app.support.validators import one_of
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.sim.conditions.keys import Setting, parse_settings
from layflat.sim.conditions.variation import Variation, variation
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
_PHYSICS = "physics="


def sim_config(conditions: Iterable[str] = (), **settings: Any) -> SimConfig:
    """Return the simulation with these settings; UsageError where a name is unknown or they do not go together.

    ``conditions`` are texts KEY=VALUE, of `--set`.
    """
    for kind, value in settings.items():
        if kind in REGISTRIES and value is not None:
            _check_name(kind, value)
    given = parse_conditions(conditions)
    try:
        return SimConfig(**(settings | given))
    except SimError as error:
        raise UsageError(str(error)) from None


def parse_conditions(texts: Iterable[str]) -> dict[str, Setting]:
    """Return the conditions of texts KEY=VALUE, `--physics` among them; UsageError where one is wrong."""
    texts = list(texts)
    engines = {text.removeprefix(_PHYSICS) for text in texts if text.startswith(_PHYSICS)}
    for name in engines:
        _check_name("physics", name)
    if len(engines) > 1:
        raise UsageError(f"physics is set to {' and to '.join(sorted(engines))}; give it once")
    try:
        given = parse_settings(text for text in texts if not text.startswith(_PHYSICS))
        return given | dict.fromkeys(["physics"] * len(engines), "".join(engines))
    except SimError as error:
        raise UsageError(f"--set: {error}") from None


def parse_variation(texts: Iterable[str], conditions: Iterable[str] = ()) -> Variation:
    """Return the variation of `--vary`; UsageError where it is wrong, or draws what `--set` sets."""
    try:
        drawn = variation(texts)
    except SimError as error:
        raise UsageError(f"--vary: {error}") from None
    for name in parse_conditions(conditions):
        if any(draw.key == name for draw in drawn.draws):
            raise UsageError(f"--set gives {name} a value, and --vary {' '.join(drawn.names)} draws it; leave one out")
    return drawn


def _check_name(kind: str, name: str) -> None:
    """Raise UsageError for an unknown name; one that belongs to another setting is said to."""
    try:
        one_of(kind, name, REGISTRIES[kind])
    except UsageError as error:
        other = next((other for other, names in REGISTRIES.items() if name in names), None)
        raise UsageError(f"{error}; {name} is a {other}: --{other} {name}" if other else str(error)) from None
