"""Python processes that never import from the user's current folder, which may hold its own ``data/`` or ``numpy.py``.

``python -m`` and ``python -c`` put the current folder first on ``sys.path``, and Python 3.10 has no ``-P``.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from typing import Any

# '' stands for the current folder; with -P or PYTHONSAFEPATH it is not there.
_RUN_MODULE = "import sys; sys.path[:] = filter(None, sys.path); import runpy; runpy.run_module(sys.argv.pop(1), "
_RUN_MODULE += "run_name='__main__', alter_sys=True)"


def python_command(module: str, *arguments: str) -> list[str]:
    """Return the command line that runs a module as ``python -m`` does, without the current folder on its path."""
    return [sys.executable, "-c", _RUN_MODULE, module, *arguments]


def fork_server_context(preload: Sequence[str]) -> Any:
    """Return a context whose processes are forked from a server that has imported ``preload``, and start the server.

    The server has neither windows nor threads, and never steps a simulation.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(preload))
    with _current_folder(os.path.dirname(os.__file__)):  # Where '' finds nothing but the standard library
        forkserver.ensure_running()
    return context


@contextmanager
def _current_folder(path: str) -> Iterator[None]:
    before = os.getcwd()
    os.chdir(path)
    try:
        yield
    finally:
        os.chdir(before)
