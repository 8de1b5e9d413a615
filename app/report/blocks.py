"""Content of a page, apart from its looks: sections of texts, tables, figures, strips and videos."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from layflat.app.media.frames import Frame


@dataclass(frozen=True)
class Table:
    """Cells as text; the first column is left-aligned."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    cited: frozenset[int] = frozenset()
    """Indices of the rows that are the thesis's, not ours."""
    runs: tuple[str, ...] = ()
    """Episode of each row, by its name, if rows are episodes; the page says how to look at it."""


@dataclass(frozen=True, kw_only=True)
class Text:
    """Paragraphs."""

    lines: tuple[str, ...]
    finding: bool = False
    """Whether they are conclusions from numbers, which are set apart."""


@dataclass(frozen=True, kw_only=True)
class TableBlock:
    """A table with its title, and a note on its columns below."""

    table: Table
    title: str = ""
    note: str = ""
    folded: bool = False
    """Whether it opens on a click: long lists."""
    wordy: bool = False
    """Whether cells are sentences: left-aligned, on several lines."""


@dataclass(frozen=True)
class Key:
    """An entry of a legend."""

    name: str
    svg: str


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Charts side by side, or below each other on a small screen, with one legend above them."""

    panels: tuple[str, ...]
    """SVG elements."""
    alt: str
    """What a reader who cannot see it should know."""
    caption: str = ""
    legend: tuple[Key, ...] = ()


@dataclass(frozen=True, kw_only=True)
class FrameStrip:
    """Frames of one episode in a row."""

    frames: tuple[Frame, ...]
    policy: str
    caption: str
    run: str = ""
    """Name of the episode."""


@dataclass(frozen=True, kw_only=True)
class VideoBlock:
    """A video, encoded when the page is written."""

    frames: Callable[[], Iterator[NDArray[np.uint8]]]
    """Called once."""
    fps: float
    poster: NDArray[np.uint8]
    """Shown before it plays, and on paper; (H, W, 3) RGB."""
    policy: str
    caption: str
    run: str = ""
    """Name of the episode."""


Block: TypeAlias = Text | TableBlock | Figure | FrameStrip | VideoBlock


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading and its blocks."""

    id: str
    """Unique on its page; letters, digits and hyphens."""
    title: str
    blocks: tuple[Block, ...]
    lead: str = ""
    short: str = ""
    """Title in the table of contents; ``title`` by default."""


@dataclass(frozen=True, kw_only=True)
class Card:
    """Numbers that matter, of one policy in one place."""

    name: str
    values: tuple[tuple[str, str, str], ...]
    """What it is, the number, and its interval and n."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """Content of a whole page."""

    title: str
    lead: str
    sections: tuple[Section, ...]
    cards: tuple[Card, ...] = ()
    notes: tuple[str, ...] = ()
    """Sentences that the reader must see first: what is missing."""
    provenance: tuple[str, ...] = ()
    """Lines at the end: how the page was made."""
