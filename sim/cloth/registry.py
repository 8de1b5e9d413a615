"""All cloths by name, and cloths of the user's by file. A new preset adds a file to ``presets``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path

from layflat.sim.cloth.cloth_file import SUFFIX, read_cloth
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError

PRESETS = Path(__file__).parent / "presets"
_ORDER = ("towel", "napkin", "towel-fine")
"""Presets that lists begin with."""
_own: dict[str, ClothSpec] = {}
"""Cloths of files and recordings that this process has met, for views that only know a name; the last of a name."""
PREFIX = "cloth_"
"""Of the fields of a cloth among the settings of a recorded simulation."""


@lru_cache(maxsize=1)
def _presets() -> Mapping[str, ClothSpec]:
    found = {path.stem: read_cloth(path).spec() for path in sorted(PRESETS.glob(f"*{SUFFIX}"))}
    return {name: found[name] for name in (*_ORDER, *found) if name in found}


CLOTHS: Mapping[str, ClothSpec] = _presets()
"""The presets: cloth 1 and cloth 2 of chapter 3-3-1, a finer mesh of the first, and other fabrics."""


def is_cloth_file(text: str) -> bool:
    """Whether a text names a cloth file and not a preset."""
    return text not in CLOTHS and (text.endswith(SUFFIX) or os.sep in text)


def cloth_spec(name: str, **changes: float) -> ClothSpec:
    """Return the cloth of a name or a file, with changes; SimError where there is none, or the file is wrong."""
    if not is_cloth_file(name):
        return replace(_known(name), **changes)  # type: ignore[arg-type]
    spec = read_cloth(Path(name).expanduser()).spec()
    if CLOTHS.get(spec.name, spec) != spec:
        raise SimError(f"{name}: the name {spec.name} is that of a preset, which is another cloth; choose another one")
    return replace(remember(spec), **changes)  # type: ignore[arg-type]


def _known(name: str) -> ClothSpec:
    known = {**_own, **CLOTHS}
    if name not in known:
        raise SimError(f"unknown cloth {name!r}; the known ones are {', '.join(CLOTHS)}, or a file, FILE.toml")
    return known[name]


def remember(spec: ClothSpec) -> ClothSpec:
    """Know a cloth by its name from now on in this process, and return it."""
    if spec.name not in CLOTHS:
        _own[spec.name] = spec
    return spec


def cloth_settings(spec: ClothSpec) -> dict[str, float | str]:
    """Return the fields of a cloth for the settings of a recorded simulation; none for a preset."""
    if CLOTHS.get(spec.name) == spec:
        return {}
    own = (item.name for item in fields(spec) if item.name not in ("name", "held_stretch"))
    return {f"{PREFIX}{name}": getattr(spec, name) for name in own}


def recorded_cloth(name: str, settings: Mapping[str, object]) -> ClothSpec:
    """Return the cloth of an episode, by its name and the settings of its simulation; SimError where it is unknown."""
    own = {key.removeprefix(PREFIX): value for key, value in settings.items() if key.startswith(PREFIX)}
    if own.keys() <= {"length_m", "width_m"}:  # A preset, of which only the size is recorded.
        return _known(name)
    try:
        whole = {key: int(str(own[key])) for key in ("rows", "columns")}
        values = {key: float(str(value)) for key, value in own.items()} | whole
        return remember(ClothSpec(name=name, **values))  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError) as error:
        raise SimError(f"the settings of cloth {name} are incomplete: {error}") from error
