"""Errors that the data package raises."""

from __future__ import annotations


class DataError(ValueError):
    """Base of the errors of the data package: what is wrong, with which value, and what would be right."""


class WriteError(DataError):
    """A file could not be written, because of the disk or the system."""

    exit_status = 1
    """Exit status of the program: the work failed, the call was right."""
