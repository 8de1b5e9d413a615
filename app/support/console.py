"""Tables on stdout."""

from __future__ import annotations

import sys

from rich.console import Console


def console(*, highlight: bool = True) -> Console:
    """Without a terminal there is no width to fit, and a cut word is of no use in a file."""
    return Console(width=None if sys.stdout.isatty() else 120, highlight=highlight)
