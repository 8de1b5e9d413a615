"""Text and tables on stdout."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

ASCII = str.maketrans({"\u2013": "-", "\u2212": "-", "\u00a0": " "})
"""Typographic signs of the pages, which a terminal or a script that reads the output may not know."""


def console(*, highlight: bool = True, width: int = 120) -> Console:
    """Return a console of the terminal's width, or of ``width`` columns where stdout is no terminal."""
    return Console(width=None if sys.stdout.isatty() else width, highlight=highlight)


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    title: str = "",
    left: int = 0,
    footer: Sequence[str] = (),
    width: int = 120,
) -> None:
    """Print a table on stdout; the first ``left`` columns are left-aligned, ``footer`` is a last row set apart."""
    table = Table(title=title or None, title_justify="left")
    for k, name in enumerate(columns):
        table.add_column(_plain(name), justify="left" if k < left else "right")
    for row in rows:
        table.add_row(*map(_plain, row))
    if footer:
        table.add_section()
        table.add_row(*map(_plain, footer))
    console(width=width).print(table)


def _plain(cell: str) -> str:
    return escape(cell.translate(ASCII))
