"""Errors of the app, and how a command ends with one: one sentence on stderr, no traceback without ``--debug``.

Exit status: 0 done; 1 the work failed; 2 the call or the input is wrong; 130 interrupted.
"""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Callable

from layflat.app.support.os_errors import describe_os_error

WORK_FAILED = 1
USAGE_ERROR = 2
INTERRUPTED = 130

PACKAGE_ERRORS = (
    ("layflat.data.errors", "DataError", USAGE_ERROR),
    ("layflat.perception.errors", "PerceptionError", USAGE_ERROR),
    ("layflat.policy.base", "PolicyError", USAGE_ERROR),
    ("layflat.sim.errors", "SimError", WORK_FAILED),
)
"""Module, base exception and exit status of each package; an error may carry its own ``exit_status``."""


class LayflatError(Exception):
    """Base of the app's errors: one sentence for a person, and the exit status."""

    def __init__(self, message: str, exit_status: int = WORK_FAILED) -> None:
        super().__init__(message)
        self.exit_status = exit_status


class UsageError(LayflatError):
    """The call or the input is wrong."""

    def __init__(self, message: str) -> None:
        super().__init__(message, USAGE_ERROR)


def run_command(work: Callable[[], int | None], *, debug: bool = False) -> int:
    """Run ``work`` and return its exit status (None is 0); an error becomes a sentence on stderr and a status.

    With ``debug`` the traceback comes first. A reader may close stdout early, as in ``layflat doctor | head``.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # Text that the terminal cannot show is no error.
    try:
        status = work() or 0
        sys.stdout.flush()
    except BrokenPipeError:
        _silence_stdout()
        return WORK_FAILED
    except BaseException as error:
        if debug and not isinstance(error, SystemExit):
            traceback.print_exc()
        return _report(error)
    if status == INTERRUPTED:
        say(_INTERRUPTED_SENTENCE)
    return status


_INTERRUPTED_SENTENCE = "interrupted; every episode and file that was reported as finished has been kept"


def _report(error: BaseException) -> int:
    """Print the sentence of ``error`` on stderr and return the exit status."""
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else WORK_FAILED
    sentence, status = format_error(error)
    say(sentence)
    return status


def format_error(error: BaseException) -> tuple[str, int]:
    """Return the sentence for a person and the exit status of an exception."""
    if isinstance(error, KeyboardInterrupt):
        return _INTERRUPTED_SENTENCE, INTERRUPTED
    if isinstance(error, LayflatError):
        return str(error), error.exit_status
    known = _package_status(error)
    if known is not None:
        return str(error), known
    if isinstance(error, MemoryError):
        return "not enough memory; close other programs, or use fewer --workers or --no-images", WORK_FAILED
    if isinstance(error, OSError):
        sentence, wrong_call = describe_os_error(error)
        return sentence, USAGE_ERROR if wrong_call else WORK_FAILED
    return (
        f"internal error, {type(error).__name__}: {_one_line(error)}; run it again with --debug and report the output",
        WORK_FAILED,
    )


def _package_status(error: BaseException) -> int | None:
    """Return the exit status of a package's own exception, None for any other.

    The classes are looked up among the loaded modules: an error cannot come from another one, and ``layflat --help``
    stays free of heavy imports.
    """
    for module, name, status in PACKAGE_ERRORS:
        base = getattr(sys.modules.get(module), name, None)
        if base is not None and isinstance(error, base):
            return int(getattr(error, "exit_status", status))
    return None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def say(sentence: str) -> None:
    """Print a sentence for a person on stderr."""
    print(f"layflat: {_plain(sentence)}", file=sys.stderr)


def _plain(sentence: str) -> str:
    return " ".join(sentence.split())


def _silence_stdout() -> None:
    """Give the interpreter a stdout it can flush at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
