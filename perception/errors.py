"""The exception of this package."""

from __future__ import annotations


class PerceptionError(ValueError):
    """Base class of the errors that perception raises. The message says what is wrong, with which value, what to do."""
