"""Readers of a disturbance's fields from plain values, as TOML has them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from layflat.sim.errors import SimError


def read_field(disturbance: str, field: str, value: Any) -> Any:
    """Return the value of a field; SimError says what is wrong with it."""
    reader, wanted = READERS[field]
    try:
        return reader(value)
    except (TypeError, ValueError):
        raise SimError(f"disturbance {disturbance}: {field} is {value!r}; it must be {wanted}") from None


def _of_type(kind: type, value: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError
    return float(value)


def _pair(value: Any) -> tuple[float, float]:
    first, second = value
    return _number(first), _number(second)


def _range(value: Any) -> tuple[float, float]:
    return _pair(value if isinstance(value, list | tuple) else (value, value))


def _patch(value: Any) -> tuple[int, int]:
    rows, columns = _pair(value)
    if rows != int(rows) or columns != int(columns):
        raise ValueError
    return int(rows), int(columns)


def _path(value: Any) -> tuple[tuple[float, float], ...]:
    return tuple(_pair(corner) for corner in value)


_RANGES = ("along", "across", "heading_deg", "scale")
_NUMBERS = ("turn_deg", "speed_m_s", "force_weights", "wind_m_s2", "time_limit_s", "settle_s")
READERS: Mapping[str, tuple[Callable[[Any], Any], str]] = {
    "kind": (lambda value: _of_type(str, value), "a word"),
    "patch": (_patch, "two whole numbers of nodes"),
    "path": (_path, "a list of [forward, up]"),
    "either_side": (lambda value: _of_type(bool, value), "true or false"),
    **dict.fromkeys(_RANGES, (_range, "one finite number or two")),
    **dict.fromkeys(_NUMBERS, (_number, "a finite number")),
}
"""Reader of each field of a plain mapping, and what it wants."""
