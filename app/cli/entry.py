"""Entry point of ``layflat``: a user's PYTHONPATH comes after Python's and Layflat's own modules.

Robotics shells have many folders there, with modules such as ``random.py`` or another version of numpy.
"""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Run the command line."""
    put_user_path_last()
    from layflat.app.cli.main import main as run

    run()


def put_user_path_last() -> None:
    """Move the folders of PYTHONPATH behind all others, except for one that Layflat itself is in."""
    theirs = {os.path.abspath(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path}
    theirs.discard(os.path.abspath(os.path.join(__file__, *[os.pardir] * 4)))
    sys.path.sort(key=lambda path: os.path.abspath(path) in theirs)
