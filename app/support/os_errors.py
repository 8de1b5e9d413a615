"""Sentences for errors of the operating system: what is wrong and what to do about it."""

from __future__ import annotations

WRONG_CALL = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError, FileExistsError)
"""A path that cannot be used is a wrong call; any other error is failed work."""


def describe_os_error(error: OSError) -> tuple[str, bool]:
    """Return one sentence with what is wrong and what to do, and whether the call was wrong."""
    from layflat.data.system_errors import ADVICE  # Here: `layflat --help` loads no package of data.

    reason = error.strerror or " ".join(str(error).split()) or type(error).__name__
    what = f"{error.filename}: {reason}" if error.filename else reason
    advice = ADVICE.get(error.errno or 0, "run it again with --debug, and report the output if it stays")
    return f"{what}; {advice}", isinstance(error, WRONG_CALL)
