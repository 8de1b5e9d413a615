"""Readers of a disturbance's fields from plain values, as TOML has them; SimError says which one is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from layflat.sim.errors import SimError


def _require(valid: bool, name: str, field: str, value: Any, wanted: str) -> None:
    if not valid:
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be {wanted}")


def _word(name: str, field: str, value: Any) -> str:
    _require(isinstance(value, str), name, field, value, "a word")
    return str(value)


def _flag(name: str, field: str, value: Any) -> bool:
    _require(isinstance(value, bool), name, field, value, "true or false")
    return bool(value)


def _number(name: str, field: str, value: Any) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    _require(number, name, field, value, "a finite number")
    return float(value)


def _pair(name: str, field: str, value: Any) -> tuple[float, float]:
    _require(isinstance(value, list | tuple) and len(value) == 2, name, field, value, "two numbers")
    return _number(name, field, value[0]), _number(name, field, value[1])


def _range(name: str, field: str, value: Any) -> tuple[float, float]:
    return _pair(name, field, value if isinstance(value, list | tuple) else (value, value))


def _patch(name: str, field: str, value: Any) -> tuple[int, int]:
    rows, columns = _pair(name, field, value)
    _require(rows == int(rows) and columns == int(columns), name, field, value, "two whole numbers of nodes")
    return int(rows), int(columns)


def _path(name: str, field: str, value: Any) -> tuple[tuple[float, float], ...]:
    _require(isinstance(value, list | tuple), name, field, value, "a list of [forward, up]")
    return tuple(_pair(name, field, corner) for corner in value)


_RANGES = ("along", "across", "heading_deg", "scale")
_NUMBERS = ("turn_deg", "speed_m_s", "force_weights", "wind_m_s2", "time_limit_s", "settle_s")
READERS: Mapping[str, Callable[[str, str, Any], Any]] = {
    "kind": _word,
    "patch": _patch,
    "path": _path,
    "either_side": _flag,
    **dict.fromkeys(_RANGES, _range),
    **dict.fromkeys(_NUMBERS, _number),
}
"""Reader of each field of a plain mapping."""
