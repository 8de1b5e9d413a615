"""Disturbance suites: TOML files with the disturbances of an episode, where, when, how strong and how often.

A suite is a list of cases, each of which is an episode of its own beside the undisturbed one::

    schema = 1
    about = "One sentence for a person."

    [[case]]
    name = "early"                  # a single case may take the suite's name

    [[case.disturbance]]
    like = "push"                   # a preset of layflat.sim.disturbances.presets, changed by the lines below;
                                    # or kind = ...
    scale = [0.5, 1.5]              # ranges are drawn by the episode's seed: the same for every policy
    when = { contact = 0.5 }        # or { step = 30 }, or "stopped", the default
    repeats = 2
"""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.workers.work_item import DisturbanceCase
from layflat.policy.base import PolicyError
from layflat.policy.schedule import ScheduledDisturbance, Trigger
from layflat.sim.disturbances.presets import DISTURBANCES, DisturbanceSpec
from layflat.sim.errors import SimError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCHEMA = 1
SUFFIX = ".toml"
MAX_BYTES = 100_000
MAX_REPEATS = 20
_SUITE_KEYS = ("schema", "about", "case")
_CASE_KEYS = ("name", "disturbance")
_SCHEDULE_KEYS = ("when", "repeats")


def shipped() -> tuple[str, ...]:
    """Return the names of the suites that Layflat brings."""
    names = (file.name for file in _folder().iterdir())
    return tuple(sorted(name.removesuffix(SUFFIX) for name in names if name.endswith(SUFFIX)))


def _folder() -> Any:
    return resources.files("layflat.app.evaluation") / "suite_files"


def cases_of(name: str) -> tuple[DisturbanceCase, ...]:
    """Return the cases of a suite, of a single disturbance, or of FILE.toml; UsageError where there are none."""
    if name in shipped():
        return parse((_folder() / f"{name}{SUFFIX}").read_text(encoding="utf-8"), name, f"suite {name}")
    if name in DISTURBANCES and name != "none":
        return (DisturbanceCase(name=name, schedule=(ScheduledDisturbance(disturbance=DISTURBANCES[name]),)),)
    path = Path(os.path.expanduser(name))
    if path.suffix == SUFFIX:
        return parse(validators.read_text(path, "a suite as TOML", max_bytes=MAX_BYTES), path.stem.lower(), str(path))
    known = ", ".join(dict.fromkeys([*shipped(), *(known for known in DISTURBANCES if known != "none")]))
    raise UsageError(f"disturbance {name!r} is unknown; give one of {known}, or a suite of your own as FILE.toml")


def parse(text: str, name: str, where: str) -> tuple[DisturbanceCase, ...]:
    """Read the cases of a suite's text; UsageError, with ``where`` it is from, for the first thing that is wrong."""
    try:
        suite = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise UsageError(f"{where} is not TOML: {error}") from None
    _known_keys(suite, _SUITE_KEYS, where)
    if suite.get("schema") != SCHEMA:
        raise UsageError(f"{where}: schema is {suite.get('schema')!r}; it must be {SCHEMA}")
    if not isinstance(suite.get("about", ""), str):
        raise UsageError(f"{where}: about is {suite['about']!r}; it must be a sentence")
    tables = _tables(suite, "case", where)
    cases = tuple(_case(table, name, f"{where}, case {n + 1}", len(tables)) for n, table in enumerate(tables))
    for case in cases:
        if [other.name for other in cases].count(case.name) > 1:
            raise UsageError(f"{where}: two cases are named {case.name}; each needs a name of its own")
    return cases


def _case(table: Mapping[str, Any], suite: str, where: str, siblings: int) -> DisturbanceCase:
    _known_keys(table, _CASE_KEYS, where)
    name = table.get("name")
    if name is None and siblings > 1:
        raise UsageError(f"{where} has no name; of several cases each needs one")
    if not isinstance(name, (str, type(None))):
        raise UsageError(f"{where}: name is {name!r}; it must be a word")
    full = suite if name is None or siblings == 1 else f"{suite}/{name}"
    items = _tables(table, "disturbance", where)
    return DisturbanceCase(name=full, schedule=tuple(_item(item, name or suite, where) for item in items))


def _item(table: Mapping[str, Any], name: str, where: str) -> ScheduledDisturbance:
    repeats = table.get("repeats", 1)
    if not _is_whole(repeats) or not 1 <= repeats <= MAX_REPEATS:
        raise UsageError(f"{where}: repeats is {repeats!r}; it must be a whole number from 1 to {MAX_REPEATS}")
    spec = _spec(table, name, where)
    return ScheduledDisturbance(
        disturbance=spec, trigger=_trigger(table.get("when", "stopped"), where), repeats=repeats
    )


def _trigger(value: object, where: str) -> Trigger:
    if value == "stopped":
        return Trigger()
    if isinstance(value, dict) and len(value) == 1:
        ((kind, number),) = value.items()
        if kind in ("step", "contact") and isinstance(number, (int, float)) and not isinstance(number, bool):
            try:
                return Trigger(kind=kind, value=number)
            except PolicyError as error:
                raise UsageError(f"{where}: {error}") from None
    raise UsageError(f'{where}: when is {value!r}; it must be "stopped", {{ step = 30 }} or {{ contact = 0.5 }}')


def _spec(table: Mapping[str, Any], name: str, where: str) -> DisturbanceSpec:
    settings = {key: value for key, value in table.items() if key not in _SCHEDULE_KEYS}
    try:
        return DisturbanceSpec.from_mapping({**settings, "name": name})
    except SimError as error:
        raise UsageError(f"{where}: {error}") from None


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _tables(parent: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    tables = parent.get(key)
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise UsageError(f"{where} has no [[{key if key == 'case' else f'case.{key}'}]]; it needs at least one")
    return tables


def _known_keys(table: Mapping[str, Any], known: Collection[str], where: str) -> None:
    for key in table:
        if key not in known:
            raise UsageError(f"{where}: {key!r} is unknown there; known are {', '.join(known)}")
