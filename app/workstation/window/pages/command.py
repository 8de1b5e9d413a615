"""CommandPage: base of pages that run a command of `layflat` in the background."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pygame

from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.window import style
from layflat.app.workstation.window.context import KeyHint
from layflat.app.workstation.window.pages.page import Page, Shows

LINE_PX = 13


@dataclass
class CommandPage(Page):
    """Page whose text area shows the command as one would type it, its progress and its output."""

    shows: Shows = "text"
    command: SubprocessCommand | None = None
    scroll: int = 0
    """Number of lines below the last one that is shown."""
    intro: ClassVar[tuple[str, ...]] = ()
    """Paragraphs that are shown before the first command."""

    @property
    def running(self) -> bool:
        """Whether a command runs."""
        return self.command is not None and self.command.running

    def run(self, arguments: list[str]) -> None:
        """Start a command; one at a time."""
        if self.running:
            self.context.show_message("a command is running; cancel it first", style.WARNING)
            return
        self.close()
        self.command, self.scroll = SubprocessCommand(arguments), 0

    def cancel(self) -> None:
        """Interrupt the command."""
        if self.command is not None and self.running:
            self.command.cancel()

    def leave(self) -> None:
        """Let the command run on while another tab is shown; only the end of the window ends it."""

    def close(self) -> None:
        """End the command."""
        if self.command is not None:
            self.command.close()

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Scroll the output."""
        if event.type == pygame.MOUSEWHEEL:
            most = max(len(self.command.lines) - 5, 0) if self.command is not None else 0
            self.scroll = min(max(self.scroll + event.y * 3, 0), most)
            return True
        return False

    def key_hints(self) -> list[KeyHint]:
        """Return the effect of each button now."""
        hints = [KeyHint("Enter", "choose and press in the menu"), KeyHint("wheel", "scroll the output")]
        cancel = KeyHint("Cancel", "end the command; finished results stay", self.cancel, style.WARNING)
        return [cancel, *hints] if self.running else hints

    def draw_text(self, surface: pygame.Surface) -> None:
        """Draw command, progress and output."""
        surface.fill(style.BACKGROUND)
        area = surface.get_rect()
        style.draw_card(surface, area)
        inner = area.inflate(-36, -28)
        if self.command is None:
            y = inner.top
            for paragraph in self.intro:
                rest = pygame.Rect(inner.left, y, min(inner.width, 640), inner.bottom - y)
                y = style.draw_block(surface, paragraph, rest, 15, style.QUIET) + 10
            return
        top = pygame.Rect(inner.left, inner.top, inner.width, 60)
        y = style.draw_block(surface, f"$ {self.command.describe()}", top, LINE_PX, style.TEXT, style.MONO) + 8
        y = self._draw_progress(surface, self.command, inner, y)
        self._draw_lines(surface, list(self.command.lines), inner, y + 10)

    def _draw_progress(self, surface: pygame.Surface, command: SubprocessCommand, inner: pygame.Rect, y: int) -> int:
        """Draw a bar while it runs, then the outcome; return the y below."""
        outcome = command.outcome()
        if outcome:
            color = style.CONTACT if command.status == 0 else style.WARNING
            return style.draw_text(surface, outcome, (inner.left, y), 16, color, face=style.BOLD).bottom
        bar = pygame.Rect(inner.left, y + 4, inner.width, 8)
        pygame.draw.rect(surface, style.RAISED, bar, border_radius=4)
        done = bar.copy()
        done.width = max(round(bar.width * command.progress), 8)
        pygame.draw.rect(surface, style.ACCENT, done, border_radius=4)
        place = (inner.left, bar.bottom + 6)
        style.draw_text(surface, command.activity or "starting", place, 13, style.QUIET, width=inner.width)
        return bar.bottom + 26

    def _draw_lines(self, surface: pygame.Surface, lines: list[str], inner: pygame.Rect, y: int) -> None:
        """Draw the last lines that fit, in a font small enough for the widest of them."""
        widest = max((len(line) for line in lines), default=0)
        sizes = (LINE_PX, 12, 11, 10)
        size = next((s for s in sizes if widest * style.text_width("m", s, style.MONO) <= inner.width), 9)
        pitch = style.font(size, style.MONO).get_linesize()
        fit = max((inner.bottom - y) // pitch, 1)
        last = len(lines) - min(self.scroll, max(len(lines) - fit, 0))
        for line in lines[max(last - fit, 0) : last]:
            color = style.WARNING if line.startswith("layflat: ") else style.TEXT
            style.draw_text(surface, line, (inner.left, y), size, color, face=style.MONO, width=inner.width)
            y += pitch
