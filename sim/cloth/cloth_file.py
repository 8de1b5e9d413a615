"""Cloth files: TOML that says what a cloth is, and the springs with which it is simulated.

The fabric is given by what a ruler and a scale measure, the mesh by ``layflat cloth fit`` or by hand::

    schema = 1
    name = "tea-towel"
    length_m = 0.26            # free edge to held edge, flat
    width_m = 0.26             # between the held corners
    mass_kg = 0.028
    hanging_stretch = 0.012    # share by which it gets longer, hung from the held edge
    bending_length_m = 0.022   # cantilever test
    friction = 0.5             # on the table

    [mesh]
    rows = 11
    ...
"""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from layflat.data.atomic_files import atomic_path
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SUFFIX = ".toml"
SCHEMA = 1
MAX_BYTES = 100_000
LIMITS: Mapping[str, tuple[float, float]] = {
    "length_m": (0.15, 0.60),
    "width_m": (0.15, 0.60),
    "mass_kg": (0.002, 1.0),
    "hanging_stretch": (0.001, 0.05),
    "bending_length_m": (0.008, 0.05),
    "friction": (0.05, 2.0),
    "rows": (2, 40),
    "columns": (2, 40),
    "elastic_n_m": (0.1, 10_000.0),
    "damping_n_s_m": (0.0, 100.0),
    "bending_n_m": (0.0, 1000.0),
    "rate_hz": (100.0, 1000.0),
}
"""Least and largest value of each number."""
_NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_MESH_TABLE = re.compile(r"^\[mesh\][^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.M)


@dataclass(frozen=True, kw_only=True)
class ClothMesh:
    """Nodes and springs of a cloth."""

    rows: int
    columns: int
    elastic_n_m: float
    damping_n_s_m: float
    bending_n_m: float
    rate_hz: float


@dataclass(frozen=True, kw_only=True)
class ClothFile:
    """Content of a cloth file; SimError where it contradicts itself."""

    name: str
    length_m: float
    width_m: float
    mass_kg: float
    hanging_stretch: float | None = None
    """Share by which it gets longer under its own weight, hung from the whole held edge."""
    bending_length_m: float | None = None
    """Of the cantilever test (ISO 9073-7): half the length that overhangs an edge with its tip 41.5 degrees below."""
    friction: float = 0.5
    mesh: ClothMesh | None = None

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise SimError(f"the cloth's name is {self.name!r}; use small letters, digits and single hyphens")
        if self.mesh is None and (self.hanging_stretch is None or self.bending_length_m is None):
            raise SimError(f"cloth {self.name} needs hanging_stretch and bending_length_m, or its springs in [mesh]")

    def spec(self) -> ClothSpec:
        """Return the cloth to simulate; SimError where it has no mesh yet."""
        if self.mesh is None:
            raise SimError(f"cloth {self.name} has no [mesh] yet; `layflat cloth fit FILE.toml` finds one")
        own = {item.name for item in fields(ClothSpec)}
        values = {name: value for name, value in vars(self).items() if name in own}
        return ClothSpec(**values, **vars(self.mesh))

    def with_mesh(self, spec: ClothSpec) -> ClothFile:
        """Return the same cloth with the nodes and springs of ``spec``."""
        return replace(self, mesh=ClothMesh(**{item.name: getattr(spec, item.name) for item in fields(ClothMesh)}))


def read_cloth(path: Path) -> ClothFile:
    """Read a cloth file; SimError says in one sentence what is wrong with it."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise SimError(f"{path} cannot be read: {error.strerror}") from error
    if len(data) > MAX_BYTES:
        raise SimError(f"{path} is no cloth file: it is longer than {MAX_BYTES // 1000} kB")
    try:
        content = tomllib.loads(data.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SimError(f"{path} is not TOML: {' '.join(str(error).split())}") from error
    try:
        return cloth_from(content)
    except SimError as error:
        raise SimError(f"{path}: {error}") from error


def cloth_from(content: Mapping[str, Any]) -> ClothFile:
    """Return the cloth of plain values, as TOML and session files have them."""
    values = dict(content)
    if values.pop("schema", None) != SCHEMA:
        raise SimError(f"schema is {content.get('schema')!r}; it must be {SCHEMA}")
    mesh = values.pop("mesh", None)
    if mesh is not None and not isinstance(mesh, dict):
        raise SimError("mesh must be a table, [mesh]")
    try:
        return ClothFile(
            **_checked(values, ClothFile, "mesh"), mesh=None if mesh is None else ClothMesh(**_checked(mesh, ClothMesh))
        )
    except TypeError as error:
        missing = re.findall(r"'(\w+)'", str(error))
        raise SimError(f"{', '.join(missing)} is missing") from error


def _checked(values: Mapping[str, Any], kind: type, *absent: str) -> dict[str, Any]:
    types = {item.name: str(item.type) for item in fields(kind) if item.name not in absent}
    checked: dict[str, Any] = {}
    for key, value in values.items():
        if key not in types:
            near = difflib.get_close_matches(key, types, 1)
            raise SimError(
                f"unknown key {key!r}; " + (f"did you mean {near[0]}?" if near else f"known: {', '.join(types)}")
            )
        if key == "name":
            if not isinstance(value, str):
                raise SimError(f"name is {value!r}; it must be text")
            checked[key] = value
            continue
        low, high = LIMITS[key]
        whole = types[key] == "int"
        number = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or not low <= value <= high:
            raise SimError(
                f"{key} is {value!r}; it must be a {'whole ' if whole else ''}number from {low:g} to {high:g}"
            )
        checked[key] = value if whole else float(value)
    return checked


def write_mesh(path: Path, mesh: ClothMesh) -> None:
    """Write ``[mesh]`` into a cloth file, in place of an older one; all other lines stay as they are."""
    text = _MESH_TABLE.sub("", path.read_text()).rstrip("\n")
    lines = [f"{name} = {value!r}" for name, value in vars(mesh).items()]
    with atomic_path(path) as aside:
        aside.write_text("\n".join([text, "", "[mesh]", *lines, ""]))
