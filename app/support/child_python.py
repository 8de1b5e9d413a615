"""Python processes that import exactly what this one does: nothing of the user's current folder or PYTHONPATH first.

``python -m`` and ``python -c`` put the current folder first on ``sys.path``, and Python 3.10 has no ``-P``; PYTHONPATH
comes before the standard library, already while the interpreter starts.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from typing import Any

from layflat.app.support.errors import LayflatError

_RUN_MODULE = (
    "import sys; sys.path[:] = {path!a}; import runpy; runpy.run_module(sys.argv.pop(1), run_name='__main__', "
    "alter_sys=True)"
)
PYTHON_PATH = "PYTHONPATH"
SOCKET_PATH_MAX = 107
"""Bytes of the path of a socket, by Linux."""
SOCKET_NAME = "/pymp-xxxxxxxx/listener-xxxxxxxx"
"""Path that multiprocessing adds to the folder for temporary files."""


def start_python(
    module: str, *arguments: str, env: Mapping[str, str] | None = None, **options: Any
) -> subprocess.Popen[Any]:
    """Start a module as ``python -m`` does, with this process's path; ``env`` is added to the environment."""
    code = _RUN_MODULE.format(path=_own_path())
    environment = {name: value for name, value in os.environ.items() if name != PYTHON_PATH} | dict(env or {})
    return subprocess.Popen([sys.executable, "-c", code, module, *arguments], env=environment, **options)


def fork_server_context(preload: Sequence[str]) -> Any:
    """Return a context whose processes are forked from a server that has imported ``preload``, and start the server.

    The server has neither windows nor threads, and never steps a simulation.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(preload))
    before, tempfile.tempdir = tempfile.tempdir, socket_folder(SOCKET_NAME)
    try:
        with own_imports_only():
            forkserver.ensure_running()
    finally:
        tempfile.tempdir = before
    return context


@contextmanager
def own_imports_only() -> Iterator[None]:
    """Have Python processes that a library starts meanwhile import what this one does."""
    folder, path = os.getcwd(), os.environ.get(PYTHON_PATH)
    os.environ[PYTHON_PATH] = os.pathsep.join(_own_path())
    os.chdir(os.path.dirname(os.__file__))  # Here '' finds nothing but the standard library.
    try:
        yield
    finally:
        os.chdir(folder)
        del os.environ[PYTHON_PATH]
        os.environ.update({} if path is None else {PYTHON_PATH: path})


def _own_path() -> list[str]:
    """Return this process's path for imports without '' and other names that depend on the current folder."""
    return [path for path in sys.path if os.path.isabs(path)]


def socket_folder(name: str) -> str:
    """Return a folder for temporary files in which the path of a socket with this ``name`` is short enough.

    It is that of TMPDIR where it can be; LayflatError where there is none.
    """
    wanted = tempfile.gettempdir()
    folders = [wanted, *filter(None, [os.environ.get("XDG_RUNTIME_DIR")]), "/tmp", "/var/tmp", "/dev/shm"]
    for folder in folders:
        if len(os.fsencode(folder + name)) <= SOCKET_PATH_MAX and os.access(folder, os.W_OK | os.X_OK):
            return folder
    raise LayflatError(
        f"the folder for temporary files, {wanted}, has too long a path for a socket; set TMPDIR to a folder whose"
        f" path has at most {SOCKET_PATH_MAX - len(name)} bytes"
    )
