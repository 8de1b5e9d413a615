"""`layflat doctor`: what this machine has, what is missing, and what to do about it.

It needs only the standard library, and runs where nothing is installed: ``python3 -m layflat.app.commands.doctor`` in
the folder that holds ``layflat``.
"""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from layflat.app.support import machine
from layflat.app.support.errors import LayflatError, run_command
from layflat.app.support.validators import SUPPORTED_PYTHONS

State = Literal["ok", "note", "problem"]

REQUIRED = {
    "gymnasium": "gymnasium",
    "viser": "viser",
    "numpy": "numpy",
    "scipy": "scipy",
    "scikit-learn": "sklearn",
    "pillow": "PIL",
    "opencv-python-headless": "cv2",
    "GPy": "GPy",
    "h5py": "h5py",
    "pygame": "pygame",
    "matplotlib": "matplotlib",
    "pandas": "pandas",
    "Jinja2": "jinja2",
    "typer": "typer",
    "rich": "rich",
    "pebble": "pebble",
    "platformdirs": "platformdirs",
}
"""Name of the distribution -> module that is imported."""

BULLETS = ("pybullet", "pybullet-arm64")
"""Distributions of PyBullet: the official one, and a fork with wheels for newer Pythons."""
MUJOCO = "mujoco-core"

INSTALL = "run `make demo`, or `pip install -c constraints.txt -e .` in a Python 3.11 environment"
MIN_MEMORY_GB = 2.0
MIN_DISK_GB = 1.0


@dataclass(frozen=True)
class Check:
    """One line: what was checked, its state, what was found, and what to do."""

    name: str
    state: State
    found: str
    advice: str = ""


def doctor() -> None:
    """Print every check; LayflatError where one is a problem."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    checks = [check for examine in EXAMINATIONS for check in examine()]
    width = max(len(check.name) for check in checks)
    for check in checks:
        print(f"{check.state:8}{check.name:{width}}  {check.found}")
        if check.advice:
            print(f"{'':8}{'':{width}}  -> {check.advice}")
    problems = [check.name for check in checks if check.state == "problem"]
    if problems:
        raise LayflatError(f"Layflat cannot run here yet; see {', '.join(problems)} above")
    print("Layflat can run here.")


def interpreter() -> list[Check]:
    """Check the version of Python."""
    found = f"{platform.python_implementation()} {platform.python_version()}, {sys.executable}"
    if sys.version_info[:2] in SUPPORTED_PYTHONS and platform.python_implementation() == "CPython":
        return [Check("interpreter", "ok", found)]
    advice = "install CPython 3.10 to 3.13, the ones PyBullet has wheels for, and name it: make PYTHON=python3.11 demo"
    return [Check("interpreter", "problem", found, advice)]


def system() -> list[Check]:
    """Check the operating system."""
    found = f"{platform.system()} {platform.machine()}"
    if (platform.system(), platform.machine()) == ("Linux", "x86_64"):
        return [Check("system", "ok", found)]
    if platform.system() == "Windows":
        return [Check("system", "problem", found, "not supported; use Linux x86-64, for instance under WSL 2")]
    advice = "PyBullet has no wheel for this system: pip compiles it, which needs a C++ compiler and ten minutes"
    return [Check("system", "note", found, advice)]


def packages() -> list[Check]:
    """Check that every package that is needed can be imported."""
    return [*engines(), *(_package(name, module) for name, module in REQUIRED.items())]


def engines() -> list[Check]:
    """Check the physics engines: Bullet in one of its two distributions, never both, and MuJoCo where it is there."""
    builds = [name for name in BULLETS if _is_there(name)]
    if len(builds) > 1:
        advice = f"both overwrite one module: pip uninstall {' '.join(BULLETS)}, then {INSTALL}"
        return [Check("physics bullet", "problem", " and ".join(builds), advice)]
    # PyBullet itself prints when it is imported first.
    found = [replace(_package((builds or BULLETS)[0], "layflat.sim.physics.bullet"), name="physics bullet")]
    found[0] = replace(found[0], found=" ".join([*builds, found[0].found]))
    if not _is_there(MUJOCO):
        return [*found, Check("physics mujoco", "note", "missing, optional", "pip install 'layflat[mujoco]'")]
    return [*found, replace(_package(MUJOCO, "layflat.sim.physics.mujoco.world"), name="physics mujoco")]


def _is_there(distribution: str) -> bool:
    try:
        return bool(version(distribution))
    except PackageNotFoundError:
        return False


def _package(name: str, module: str) -> Check:
    """Check that a package is installed and can be imported."""
    try:
        found = version(name)
    except PackageNotFoundError:
        return Check(name, "problem", "missing", INSTALL)
    try:
        importlib.import_module(module)
    except Exception as error:
        reason = " ".join(str(error).split())
        return Check(name, "problem", f"{found}, but it does not load: {reason}", f"reinstall it: {INSTALL}")
    return Check(name, "ok", found)


def videos() -> list[Check]:
    """Check that .webm videos can be written, by writing one."""
    try:
        import numpy as np

        from layflat.app.media.video import write_video

        with tempfile.TemporaryDirectory() as folder:
            write_video(Path(folder) / "video.webm", [np.zeros((48, 64, 3), np.uint8)] * 3)
    except Exception as error:
        return [Check("videos (.webm)", "problem", " ".join(str(error).split()), f"reinstall OpenCV: {INSTALL}")]
    return [Check("videos (.webm)", "ok", "written and read back")]


def resources() -> list[Check]:
    """Check cores, disk and memory."""
    cores = machine.available_cores()
    advice = "one core works; a demo then takes about twice as long" if cores < 2 else ""
    lines = [Check("cores", "note" if advice else "ok", f"{cores} of {os.cpu_count()}", advice)]
    free_gb = shutil.disk_usage(Path.cwd()).free / 1e9
    advice = f"free some: recordings with images need it, at least {MIN_DISK_GB:g} GB" if free_gb < MIN_DISK_GB else ""
    lines.append(Check("free disk", "note" if advice else "ok", f"{free_gb:.1f} GB in {Path.cwd()}", advice))
    size = machine.memory_bytes()
    if size is None:
        return lines
    advice = "use --workers 1 and --no-images" if size / 1e9 < MIN_MEMORY_GB else ""
    limited = ", a limit of this container or job" if machine.memory_limit_bytes() else ""
    lines.append(Check("memory", "note" if advice else "ok", f"{size / 1e9:.1f} GB{limited}", advice))
    workers = machine.default_workers()
    return [*lines, Check("workers", "ok", f"{workers} where --workers is not given")]


def display() -> list[Check]:
    """Check for a display."""
    found = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if found or platform.system() == "Darwin":
        return [Check("display", "ok", found or "built in")]
    return [
        Check(
            "display",
            "note",
            "none",
            "only `layflat app` needs one: `layflat record` by hand works in the terminal, with keys or a pad",
        )
    ]


def gamepads() -> list[Check]:
    """Find gamepads as recording does."""
    try:
        devices = importlib.import_module("layflat.app.workstation.teleop.devices")
        pads = devices.GamepadRegistry(*importlib.import_module("layflat.app.workstation.teleop.sdl").start())
        pads.refresh()
        found = [f"{device.name} (known by {device.source})" for device in pads.devices.values()]
        unknown = list(pads.unknown.values())
        pads.close()
    except Exception as error:
        return [Check("gamepad", "note", f"cannot look: {' '.join(str(error).split())}")]
    lines = [Check("gamepad", "ok", name) for name in found]
    lines += [Check("gamepad", "note", "one that cannot be used yet", sentence) for sentence in unknown]
    return lines or [Check("gamepad", "note", "none", "not needed: --source keyboard and scripted work without one")]


EXAMINATIONS: tuple[Callable[[], list[Check]], ...] = (
    interpreter,
    system,
    packages,
    videos,
    resources,
    display,
    gamepads,
)


if __name__ == "__main__":
    sys.exit(run_command(doctor))
