"""Errors that the sim package raises."""

from __future__ import annotations


class SimError(ValueError):
    """Base of the errors of the simulation."""
