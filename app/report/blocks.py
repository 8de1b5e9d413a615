"""What a report says, apart from how it looks: sections of texts, tables, figures, strips and films."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from layflat.app.media.frames import Frame
from layflat.app.report.tables import Table


@dataclass(frozen=True, kw_only=True)
class Text:
    """Paragraphs. ``finding``: what the numbers say, set apart from what was done."""

    lines: tuple[str, ...]
    finding: bool = False


@dataclass(frozen=True, kw_only=True)
class TableBlock:
    """A table, with a sentence below that says what its columns are."""

    table: Table
    title: str = ""
    note: str = ""
    folded: bool = False
    """Shown only when asked for: long lists."""
    wordy: bool = False
    """Cells are sentences, not numbers: to the left, and on several lines."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A PNG."""

    png: bytes
    alt: str
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class FrameStrip:
    """Frames of one episode in a row; ``tag`` is the policy."""

    frames: tuple[Frame, ...]
    tag: str
    caption: str


@dataclass(frozen=True, kw_only=True)
class VideoBlock:
    """A film, made when the page is; ``frames`` may be called once."""

    frames: Callable[[], Iterator[NDArray[np.uint8]]]
    fps: float
    tag: str
    caption: str


Block: TypeAlias = Text | TableBlock | Figure | FrameStrip | VideoBlock


@dataclass(frozen=True, kw_only=True)
class Section:
    """One heading and what is below it."""

    id: str
    """Unique on its page; letters, digits and hyphens."""
    title: str
    blocks: tuple[Block, ...]
    lead: str = ""
    short: str = ""
    """Title in the page's table of contents; ``title`` by default."""


@dataclass(frozen=True, kw_only=True)
class Card:
    """One number that matters, with a word above and a word below."""

    name: str
    value: str
    below: str = ""


@dataclass(frozen=True, kw_only=True)
class Page:
    """Everything that a page shows."""

    title: str
    lead: str
    sections: tuple[Section, ...]
    cards: tuple[Card, ...] = ()
    notes: tuple[str, ...] = ()
    """Sentences for the reader before anything else: what fell short, what was cut."""
    made: tuple[str, ...] = field(default_factory=tuple)
    """How this was made: lines at the end."""
