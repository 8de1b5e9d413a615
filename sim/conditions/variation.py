"""Variation: ranges of conditions, from which each seed draws its own.

A variation is a TOML file::

    schema = 1
    about = "One sentence for a person."

    [draw]                                          # keys of `layflat config`
    mass_factor = { log_uniform = [0.5, 2.0] }      # also: uniform = [low, high], choice = [a, b, c]
"""

from __future__ import annotations

import math
import sys
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from layflat.sim.conditions.keys import Key, Setting, key_of
from layflat.sim.errors import SimError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCHEMA = 1
SUFFIX = ".toml"
MAX_BYTES = 100_000
FOLDER = Path(__file__).parent / "variations"
STREAM = 0x7A21
"""Separates the random numbers of variations from others of the same seed."""
LAWS = ("uniform", "log_uniform", "choice")


@dataclass(frozen=True)
class Draw:
    """How the values of one key are drawn."""

    key: str
    law: str
    values: tuple[Setting, ...]
    """Least and greatest value, or all that are chosen from."""

    def sample(self, seed: int) -> Setting:
        """Return the value of a seed, which does not depend on what else is drawn."""
        rng = np.random.default_rng([seed, STREAM, zlib.crc32(self.key.encode())])
        if self.law == "choice":
            return self.values[int(rng.integers(len(self.values)))]
        low, high = map(float, self.values)
        whole = isinstance(self.values[0], int)
        if self.law == "log_uniform":
            drawn = math.exp(rng.uniform(math.log(low), math.log(high)))
            return round(drawn) if whole else min(max(drawn, low), high)
        return int(rng.integers(int(low), int(high) + 1)) if whole else float(rng.uniform(low, high))


@dataclass(frozen=True)
class Variation:
    """Conditions that are drawn for each seed; SimError where two parts of it draw the same key."""

    draws: tuple[Draw, ...] = ()
    names: tuple[str, ...] = field(default=(), compare=False)
    """Names by which a user asked for it."""

    def __post_init__(self) -> None:
        drawn = [draw.key for draw in self.draws]
        for key in drawn:
            if drawn.count(key) > 1:
                raise SimError(f"{key} is drawn twice; give only one of {', '.join(self.names)}")

    def sample(self, seed: int) -> dict[str, Setting]:
        """Return the conditions of a seed, by key: the same for every policy, robot and cloth."""
        return {draw.key: draw.sample(seed) for draw in self.draws}

    def described(self) -> dict[str, Any]:
        """Return the ranges as JSON values, by key."""
        return {draw.key: {draw.law: list(draw.values)} for draw in self.draws}


NO_VARIATION = Variation()


def shipped() -> tuple[str, ...]:
    """Return the names of the variations that Layflat brings."""
    return tuple(sorted(path.stem for path in FOLDER.glob(f"*{SUFFIX}")))


def variation(texts: Iterable[str]) -> Variation:
    """Return the variation of names and files together; SimError says in one sentence what is wrong with them."""
    names = tuple(dict.fromkeys(texts))
    return Variation(tuple(draw for name in names for draw in _draws(name)), names)


def _draws(name: str) -> tuple[Draw, ...]:
    path = FOLDER / f"{name}{SUFFIX}" if name in shipped() else Path(name).expanduser()
    if path.suffix != SUFFIX:
        raise SimError(f"variation {name!r} is unknown; give one of {', '.join(shipped())}, or a FILE.toml")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SimError(f"{path} cannot be read: {error.strerror or error}") from error
    if len(data) > MAX_BYTES:
        raise SimError(f"{path} is no variation: it is longer than {MAX_BYTES // 1000} kB")
    try:
        content = tomllib.loads(data.decode("utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise SimError(f"{path} is not TOML: {' '.join(str(error).split())}") from None
    try:
        return parse_variation(content)
    except SimError as error:
        raise SimError(f"{path}: {error}") from None


def parse_variation(content: Mapping[str, Any]) -> tuple[Draw, ...]:
    """Return what the plain values of a file draw; SimError for the first thing that is wrong."""
    for name in content:
        if name not in ("schema", "about", "draw"):
            raise SimError(f"{name!r} is unknown there; known are schema, about, draw")
    if content.get("schema") != SCHEMA:
        raise SimError(f"schema is {content.get('schema')!r}; it must be {SCHEMA}")
    table = content.get("draw")
    if not isinstance(table, dict) or not table:
        raise SimError("there is no [draw]; it needs at least one key of `layflat config`")
    return tuple(_draw(key_of(name), law) for name, law in table.items())


def _draw(key: Key, given: Any) -> Draw:
    if not isinstance(given, dict) or len(given) != 1 or not {*given} <= {*LAWS}:
        raise SimError(f"{key.name} is {given!r}; it must be one of {{ {' = [...] }, { '.join(LAWS)} = [...] }}")
    if not key.varies:
        raise SimError(f"{key.name} cannot be drawn, as all episodes of a session share it; use --set")
    ((law, values),) = given.items()
    if not isinstance(values, list) or not values or (law != "choice" and len(values) != 2):
        wanted = "a list of values" if law == "choice" else "[low, high]"
        raise SimError(f"{law} of {key.name} is {values!r}; it must be {wanted}")
    if key.choices and law != "choice":
        raise SimError(f"{key.name} is one of {key.wanted}; use choice = [...]")
    checked = tuple(key.checked(value) for value in values)
    if law != "choice":
        low, high = map(float, checked)
        if low >= high:
            raise SimError(f"{law} of {key.name} runs from {low:g} to {high:g}; give the lower value first")
        if law == "log_uniform" and low <= 0:
            raise SimError(f"log_uniform of {key.name} begins at {low:g}; it must begin above 0")
    return Draw(key.name, law, checked)
