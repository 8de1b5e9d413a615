"""The one exception of this package."""

from __future__ import annotations


class PerceptionError(ValueError):
    """Base of what the perception package raises: says what is wrong, with which value, and what would be right."""
