"""Who made a result, with what: versions, platform, time, command line."""

from __future__ import annotations

import getpass
import os
import platform
import shlex
import sys
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from data.types import Provenance

PACKAGES = ("layflat", "pybullet", "numpy", "scipy", "opencv-python-headless", "gymnasium", "GPy", "h5py")
"""Whose version can change a number."""
OPERATOR = "LAYFLAT_OPERATOR"
"""Environment variable that names the person in records; the login name by default."""


def provenance_now() -> Provenance:
    """Provenance of what this process makes at this moment."""
    versions = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:  # run from a source folder that is not installed
            continue
    return Provenance(
        versions=versions,
        platform=platform.platform(),
        created_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        command=shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        operator=os.environ.get(OPERATOR) or _login(),
    )


def _login() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # A container may run under a number that has no name.
        return ""
