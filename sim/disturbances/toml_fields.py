"""Readers of a disturbance's fields from plain values, as TOML has them; SimError says which one is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from layflat.sim.errors import SimError


def _word(name: str, field: str, value: Any) -> str:
    if not isinstance(value, str):
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be a word")
    return value


def _number(name: str, field: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be a finite number")
    return float(value)


def _pair(name: str, field: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be two numbers")
    return _number(name, field, value[0]), _number(name, field, value[1])


def _range(name: str, field: str, value: Any) -> tuple[float, float]:
    if isinstance(value, list | tuple):
        return _pair(name, field, value)
    if isinstance(value, str):
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be a number, or two of them")
    number = _number(name, field, value)
    return number, number


def _yes_or_no(name: str, field: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be true or false")
    return value


def _patch(name: str, field: str, value: Any) -> tuple[int, int]:
    rows, columns = _pair(name, field, value)
    if rows != int(rows) or columns != int(columns):
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be two whole numbers of nodes")
    return int(rows), int(columns)


def _path(name: str, field: str, value: Any) -> tuple[tuple[float, float], ...]:
    if not isinstance(value, list | tuple):
        raise SimError(f"disturbance {name}: {field} is {value!r}; it must be a list of [forward, up]")
    return tuple(_pair(name, field, corner) for corner in value)


READERS: Mapping[str, Callable[[str, str, Any], Any]] = {
    "kind": _word,
    "along": _range,
    "across": _range,
    "patch": _patch,
    "heading_deg": _range,
    "path": _path,
    "turn_deg": _number,
    "scale": _range,
    "either_side": _yes_or_no,
    "speed_m_s": _number,
    "force_weights": _number,
    "wind_m_s2": _number,
    "time_limit_s": _number,
    "settle_s": _number,
}
"""Reader of each field of a plain mapping."""
