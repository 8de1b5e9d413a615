"""Imports of packages that only the exports need."""

from __future__ import annotations

import importlib
from types import ModuleType

from layflat.data.errors import DataError

EXTRAS = {"PIL": ("pillow", "export"), "minari": ("minari", "minari"), "rerun": ("rerun-sdk", "rerun")}
"""Package and extra of a module, where they have other names than the module and ``export``."""


def require(name: str) -> ModuleType:
    """Return the module, or raise a DataError that says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        top = name.split(".")[0]
        package, extra = EXTRAS.get(top, (top, "export"))
        raise DataError(
            f"this export needs the package {package}, which is not installed; pip install 'layflat[{extra}]'"
        ) from None
