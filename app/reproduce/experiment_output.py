"""Blocks and claims of one experiment."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from layflat.app.report.blocks import Block, Table, TableBlock, Text
from layflat.app.reproduce.claims import Claim

MISSING = "Not run yet; the same command continues with it."


@dataclass
class ExperimentOutput:
    """Collects what an experiment shows, in the order of the page."""

    blocks: list[Block] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)

    def add_table(self, table: Table, *, title: str = "", note: str = "") -> None:
        """Add a table; a note that already stands below another table is not repeated."""
        repeated = any(isinstance(block, TableBlock) and block.note == note for block in self.blocks)
        self.blocks.append(TableBlock(table=table, title=title, note="" if repeated else note))

    def add_findings(self, lines: Iterable[str]) -> None:
        """Add sentences on what the numbers show, if there are any."""
        lines = tuple(lines)
        if lines:
            self.blocks.append(Text(lines=lines, finding=True))

    def add_missing(self, where: str = "") -> None:
        """Say that a part was not run."""
        self.blocks.append(Text(lines=(f"{where}: {MISSING}" if where else MISSING,)))
