"""A Page as one HTML file, and its texts and tables as Markdown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from layflat.app.report.blocks import Block, Figure, FrameStrip, Page, Table, TableBlock, Text, VideoBlock
from layflat.app.report.html_assets import frame_views, page_template, png_uri, video_uri
from layflat.data.atomic_files import write_text

OnProgress = Callable[[str], None]


def write_page(path: Path, page: Page, *, on_progress: OnProgress | None = None) -> None:
    """Write the page, whole or not at all; ``on_progress`` is called with each section's title."""
    views = []
    for section in page.sections:
        if on_progress is not None:
            on_progress(section.short or section.title)
        views.append({"section": section, "blocks": [_view(block) for block in section.blocks]})
    write_text(path, page_template().render(page=page, views=views))


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
    if isinstance(block, Figure):
        view["uri"] = png_uri(block.png)
    elif isinstance(block, FrameStrip):
        view["frames"] = frame_views(block.frames)
    elif isinstance(block, VideoBlock):
        view["uri"] = video_uri(block.frames(), fps=block.fps)
    return view
