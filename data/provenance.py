"""Provenance of a result: versions, git revision, platform, time, command line."""

from __future__ import annotations

import functools
import getpass
import os
import platform
import shlex
import subprocess
import sys
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from layflat.data.types import Provenance

PACKAGES = (
    "layflat",
    "pybullet",
    "pybullet-arm64",
    "mujoco-core",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "gymnasium",
    "GPy",
    "h5py",
)
"""Whose version can change a number."""
OPERATOR = "LAYFLAT_OPERATOR"
"""Environment variable that names the person in records; the login name by default."""


def capture_provenance() -> Provenance:
    """Provenance of what this process makes at this moment."""
    versions = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:  # run from a source folder that is not installed
            continue
    if revision := git_revision():
        versions["git"] = revision
    return Provenance(
        versions=versions,
        platform=platform.platform(),
        created_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        command=shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        operator=os.environ.get(OPERATOR) or _login(),
    )


@functools.cache
def git_revision() -> str:
    """Commit of the working copy that this program runs from, with "+changes" where files differ; "" outside of one."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", Path(__file__).name)  # Another project's folder may have Layflat installed.
        return git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


def _login() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # A container may run under a number that has no name.
        return ""
