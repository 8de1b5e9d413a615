"""A Page as one HTML file, and its texts and tables as Markdown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from layflat.app.report.blocks import Block, FrameStrip, Page, Table, TableBlock, Text, VideoBlock
from layflat.app.report.html_assets import frame_views, jpeg_uri, page_template, video_uri
from layflat.data.atomic_files import write_text

OnProgress = Callable[[float, str], None]
"""Called with a share of the page that is done, in addition to those before, and the title of a section."""


def no_progress(share: float, title: str) -> None:
    """Do nothing: the default of ``on_progress``."""


def write_page(path: Path, page: Page, *, on_progress: OnProgress = no_progress) -> None:
    """Write the page, whole or not at all; it reports half of the progress."""
    views = []
    for section in page.sections:
        views.append({"section": section, "blocks": [_view(block) for block in section.blocks]})
        on_progress(0.5 / len(page.sections), section.short or section.title)
    write_text(path, page_template().render(page=page, views=views, shown=_shown(page)))


def _shown(page: Page) -> dict[str, str]:
    """Return what the page has of each run: its film or its frames."""
    blocks = [block for section in page.sections for block in section.blocks]
    kinds = ((FrameStrip, "frames"), (VideoBlock, "film"))
    return {b.run: name for kind, name in kinds for b in blocks if isinstance(b, kind) and b.run}


def markdown(page: Page) -> str:
    """Return the headings, texts and tables of a page; folded tables and pictures are left out."""
    parts = [f"# {page.title}", page.lead, *(f"- {note}" for note in page.notes)]
    for section in page.sections:
        parts += [f"## {section.title}", section.lead]
        parts += [text for block in section.blocks for text in _markdown_of(block)]
    parts.append("\n".join(page.provenance))
    return "\n\n".join(part for part in parts if part) + "\n"


def table_markdown(table: Table, *, wordy: bool = False) -> str:
    """Return a pipe table; bars in cells are escaped."""
    lines = [table.header, ("---",) + ("---" if wordy else "---:",) * (len(table.header) - 1), *table.rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _markdown_of(block: Block) -> list[str]:
    if isinstance(block, Text):
        return [f"**{line}**" if block.finding else line for line in block.lines]
    if isinstance(block, TableBlock) and not block.folded:
        title = [f"### {block.title}"] if block.title else []
        return [*title, table_markdown(block.table, wordy=block.wordy), *([block.note] if block.note else [])]
    return []


def _view(block: Block) -> dict[str, Any]:
    """Return a block for the template: its kind, itself, and its pictures as data URIs."""
    view: dict[str, Any] = {"kind": type(block).__name__, "block": block}
    if isinstance(block, FrameStrip):
        view["frames"] = frame_views(block.frames)
    elif isinstance(block, VideoBlock):
        view |= {"uri": video_uri(block.frames(), fps=block.fps), "poster": jpeg_uri(block.poster)}
    return view
