"""Modes that run a command of `layflat` in the background: its words, its progress, and its end."""

from __future__ import annotations

from dataclasses import dataclass, field

import pygame

from layflat.app.workstation.window import style
from layflat.app.workstation.window.pages.page import BasePage, KeyHint, Shows
from layflat.app.workstation.window.subprocess_command import SubprocessCommand

LINE_PX = 13


@dataclass
class CommandPage(BasePage):
    """The text area shows the command as one would type it, how far it is, and what it printed."""

    shows: Shows = "text"
    job: SubprocessCommand | None = None
    scroll: int = 0
    """Lines above the last that are shown at the bottom."""
    intro: tuple[str, ...] = field(default=())
    """What is said before there is a command."""

    def run(self, arguments: list[str]) -> None:
        """Start a command; one at a time."""
        if self.job is not None and self.job.status is None:
            self.shop.say("a command is running; cancel it first", style.WARNING)
            return
        if self.job is not None:
            self.job.close()
        self.job, self.scroll = SubprocessCommand(arguments), 0

    def cancel(self) -> None:
        if self.job is not None and self.job.status is None:
            self.job.cancel()

    def leave(self) -> None:
        """Another tab may be looked at while it goes on; only the window's end ends it."""

    def close(self) -> None:
        if self.job is not None:
            self.job.close()

    def handle(self, event: pygame.event.Event) -> bool:
        if event.type == pygame.MOUSEWHEEL:
            most = max(len(self.job.lines) - 5, 0) if self.job is not None else 0
            self.scroll = min(max(self.scroll + event.y * 3, 0), most)
            return True
        return False

    def chips(self) -> list[KeyHint]:
        chips = [KeyHint("Enter", "choose and press in the menu"), KeyHint("wheel", "scroll what was printed")]
        if self.job is not None and self.job.status is None:
            return [
                KeyHint("Cancel", "end the command; what it has finished stays", self.cancel, style.WARNING),
                *chips,
            ]
        return chips

    def paint_text(self, surface: pygame.Surface) -> None:
        surface.fill(style.GROUND)
        area = surface.get_rect()
        style.card(surface, area)
        inner = area.inflate(-36, -28)
        if self.job is None:
            y = inner.top
            for paragraph in self.intro:
                rest = pygame.Rect(inner.left, y, min(inner.width, 640), inner.bottom - y)
                y = style.write_block(surface, paragraph, rest, 15, style.QUIET) + 10
            return
        top = pygame.Rect(inner.left, inner.top, inner.width, 60)
        y = style.write_block(surface, f"$ {self.job.told}", top, LINE_PX, style.TEXT, style.MONO) + 8
        y = self._paint_progress(surface, self.job, inner, y)
        self._paint_lines(surface, self.job, inner, y + 10)

    def _paint_progress(self, surface: pygame.Surface, job: SubprocessCommand, inner: pygame.Rect, y: int) -> int:
        """A bar while it runs, then one word; returns the y below."""
        ended = job.outcome()
        if ended:
            colour = style.CONTACT if job.status == 0 else style.WARNING
            return style.write(surface, ended, (inner.left, y), 16, colour, face=style.BOLD).bottom
        bar = pygame.Rect(inner.left, y + 4, inner.width, 8)
        pygame.draw.rect(surface, style.RAISED, bar, border_radius=4)
        done = bar.copy()
        done.width = max(round(bar.width * job.share), 8)
        pygame.draw.rect(surface, style.ACCENT, done, border_radius=4)
        style.write(surface, job.doing or "starting", (inner.left, bar.bottom + 6), 13, style.QUIET, width=inner.width)
        return bar.bottom + 26

    def _paint_lines(self, surface: pygame.Surface, job: SubprocessCommand, inner: pygame.Rect, y: int) -> None:
        """The last lines that fit, in letters small enough for the widest of them."""
        lines = list(job.lines)
        widest = max((len(line) for line in lines), default=0)
        size = next(
            (s for s in (LINE_PX, 12, 11, 10) if widest * style.text_width("m", s, style.MONO) <= inner.width), 9
        )
        pitch = style.font(size, style.MONO).get_linesize()
        fit = max((inner.bottom - y) // pitch, 1)
        last = len(lines) - min(self.scroll, max(len(lines) - fit, 0))
        for line in lines[max(last - fit, 0) : last]:
            failed = line.startswith("layflat: ")
            colour = style.WARNING if failed else style.TEXT
            style.write(surface, line, (inner.left, y), size, colour, face=style.MONO, width=inner.width)
            y += pitch
