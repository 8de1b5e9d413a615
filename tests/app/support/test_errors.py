"""Every failure is one sentence on stderr and the right exit status."""

from __future__ import annotations

import errno
import subprocess
import sys

import pytest

from layflat.app.support.errors import LayflatError, UsageError, run_command
from layflat.data.errors import DataError
from layflat.data.system_errors import ADVICE
from layflat.perception.errors import PerceptionError
from layflat.policy.base import PolicyError


def _raise(error: BaseException) -> int:
    raise error


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (LayflatError("work failed"), 1),
        (UsageError("wrong"), 2),
        (DataError("the file is cut off"), 2),
        (PolicyError("model of the other robot"), 2),
        (PerceptionError("depth has the wrong shape"), 2),
        (KeyboardInterrupt(), 130),
        (MemoryError(), 1),
        (OSError(errno.ENOSPC, "No space left on device", "x.h5"), 1),
        (FileNotFoundError(errno.ENOENT, "No such file or directory", "x.h5"), 2),
        (PermissionError(errno.EACCES, "Permission denied", "x.h5"), 2),
        (OSError(errno.EIO, "Input/output error"), 1),
        (ZeroDivisionError("line one\nline two"), 1),
    ],
)
def test_one_sentence_and_the_status(error, status, capsys):
    assert run_command(lambda: _raise(error)) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("layflat: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_an_error_may_carry_its_own_status(capsys):
    class Unstable(PolicyError):
        exit_status = 1

    assert run_command(lambda: _raise(Unstable("the fit failed"))) == 1


def test_debug_shows_the_traceback_as_well(capsys):
    assert run_command(lambda: _raise(UsageError("wrong value 3")), debug=True) == 2
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert err.splitlines()[-1] == "layflat: wrong value 3"


def test_nothing_raised_is_zero():
    assert run_command(lambda: None) == 0


def test_a_reader_that_closes_stdout_sees_no_traceback():
    program = (
        "from layflat.app.support.errors import run_command; "
        "run_command(lambda: [print(i) for i in range(200000)] and 0)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout
        assert child.stderr
        child.stdout.readline()
        child.stdout.close()
        assert child.stderr.read() == ""


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (OSError("AF_UNIX path too long"), "AF_UNIX path too long; run it again with --debug"),
        (OSError(errno.EIO, "Input/output error", "x.h5"), "x.h5: Input/output error; the disk reports an error"),
        (OSError(errno.EMFILE, "Too many open files"), "Too many open files; too many files are open: raise the limit"),
        (OSError(), "OSError; run it again with --debug"),
        *((OSError(number, "reason", "x.h5"), "x.h5: reason; ") for number in ADVICE),
    ],
)
def test_an_error_of_the_system_says_what_and_what_to_do(error, sentence, capsys):
    run_command(lambda: _raise(error))
    assert capsys.readouterr().err.startswith(f"layflat: {sentence}")
