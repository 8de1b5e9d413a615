"""Checks of a call before its work begins: numbers, names, paths, the interpreter."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from layflat.app.support.errors import LayflatError, UsageError

SUPPORTED_PYTHONS = ((3, 10), (3, 11), (3, 12), (3, 13))
SESSION_SUFFIXES = (".h5", ".hdf5")


def require_simulator() -> None:
    """Raise LayflatError where this interpreter cannot run the simulation."""
    if sys.version_info[:2] not in SUPPORTED_PYTHONS:
        raise LayflatError(
            f"Layflat needs Python 3.10 to 3.13, the ones PyBullet has wheels for, and this is "
            f"{sys.version_info[0]}.{sys.version_info[1]}; `layflat doctor` says what to do"
        )
    if importlib.util.find_spec("pybullet") is None:
        raise LayflatError("PyBullet is not installed for this interpreter; `layflat doctor` says what to do")


def positive(name: str, value: int) -> int:
    """Return the number if it is at least 1, else raise UsageError."""
    if value < 1:
        raise UsageError(f"{name} is {value}; at least 1 is needed")
    return value


def seed_in_range(value: int) -> int:
    """Return the seed if numpy takes it, else raise UsageError."""
    if not 0 <= value < 2**32:
        raise UsageError(f"--seed is {value}; it must be between 0 and {2**32 - 1}")
    return value


def episode_number(value: int) -> int:
    """Return the number of a demo if it can be one, else raise UsageError."""
    if not 0 <= value < 10**9:
        raise UsageError(f"--episode is {value}; it must be the number of a demo, such as 3 for demo_3")
    return value


def one_of(kind: str, name: str, known: Iterable[str]) -> str:
    """Return ``name`` if it is among ``known``, else raise UsageError, which lists them."""
    names = sorted(known)
    if name not in names:
        raise UsageError(f"{kind} {name!r} is unknown; known ones are {', '.join(names)}")
    return name


def readable_file(path: Path, what: str) -> Path:
    """Return ``path`` if it is a file that can be read, else raise UsageError; ``what`` says what it should be."""
    if not path.exists():
        raise UsageError(f"{path} does not exist; give {what}")
    if not path.is_file():
        raise UsageError(f"{path} is not a file; give {what}")
    if not os.access(path, os.R_OK):
        raise UsageError(f"{path} cannot be read; check its permissions")
    return path


def writable_file(path: Path, *, force: bool, append: bool = False, suffix: str | tuple[str, ...] = ()) -> Path:
    """Make the folder of an output file and check, before hours of work, that the file can be written; else UsageError.

    A file that exists needs ``force``, or ``append`` where the work only adds to it. ``suffix``: ends of its name.
    """
    endings = (suffix,) if isinstance(suffix, str) else suffix
    if endings and path.suffix.lower() not in endings:
        wanted = " or ".join(endings)
        raise UsageError(f"{path} is not a {wanted} file; give a name that ends in {wanted}")
    if path.is_dir():
        raise UsageError(f"{path} is a folder; give the name of a file")
    if path.exists() and not (force or append):
        raise UsageError(f"{path} exists; give --force to replace it, or another name")
    if path.exists() and not os.access(path, os.W_OK):
        raise UsageError(f"{path} cannot be written; check its permissions")
    writable_folder(path.parent)
    return path


def writable_folder(path: Path) -> Path:
    """Make a folder where it is missing and check that a file can be written into it, else raise UsageError."""
    probe = path / f".layflat-probe-{os.getpid()}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UsageError(f"{path} cannot be written ({error.strerror or error}); choose another place") from error
    return path


def read_text(path: Path, what: str, *, max_bytes: int) -> str:
    """Return the text of a file that a person wrote, with or without a byte order mark; else raise UsageError."""
    try:
        if (size := path.stat().st_size) > max_bytes:
            raise UsageError(f"{path} has {size} bytes; {what} has at most {max_bytes}")
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise UsageError(f"{path} cannot be read ({error.strerror or error}); give {what}") from None
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise UsageError(f"{path} is not UTF-8 text; save it as UTF-8, an encoding that editors offer where they save")
    return text
