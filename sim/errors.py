"""Errors that the sim package raises."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

T = TypeVar("T")


class SimError(ValueError):
    """Base of the errors of the simulation."""


def look_up(kind: str, name: str, known: Mapping[str, T]) -> T:
    """Return an entry of a registry; SimError lists the known names."""
    if name not in known:
        raise SimError(f"unknown {kind} {name!r}; the known ones are {', '.join(known)}")
    return known[name]
