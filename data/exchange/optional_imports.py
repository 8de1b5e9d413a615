"""Imports of packages that only the exports need."""

from __future__ import annotations

import importlib
from types import ModuleType

from layflat.data.errors import DataError


def require(name: str) -> ModuleType:
    """Return the module, or raise a DataError that says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        package = {"PIL": "pillow"}.get(name.split(".")[0], name.split(".")[0])
        raise DataError(
            f"this export needs the package {package}, which is not installed; pip install 'layflat[export]'"
        ) from None
