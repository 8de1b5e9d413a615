"""Replay: choose a session and an episode, and go through it step by step."""

from __future__ import annotations

import time
from dataclasses import dataclass

import pygame

from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.window import menu_style, style
from layflat.app.workstation.window.pages.page import BasePage, FormRow, KeyHint
from layflat.app.workstation.window.playback import Playback, checked_playback, facts
from layflat.app.workstation.window.subprocess_command import SubprocessCommand
from layflat.app.workstation.window.time_series import TimeSeries
from layflat.data.format.schema import demo_number
from layflat.data.session.reader import open_session

SCRUB_PX = 34
"""Height of the bar at the bottom of the view."""


@dataclass
class ReplayPage(BasePage):
    name: str = "Replay"
    session: str = ""
    episode: str = ""
    playback: Playback | None = None
    at: int = 0
    """The moment that is shown."""
    playing: bool = False
    job: SubprocessCommand | None = None
    """An action replay that checks it."""
    _due_s: float = 0.0
    _scrubbing: bool = False

    def build(self) -> None:
        shop, width = self.shop, self.shop.place.panel.width
        self.menu = menu = menu_style.menu(shop.place.panel)
        menu_style.heading(menu, "Replay")
        sessions = shop.sessions()
        if not sessions:
            menu_style.note(menu, f"There is no session in {shop.folder}; record one first.", width)
            return
        self.session = self.session if self.session in sessions else sessions[0]
        menu_style.choice(menu, "Session", sessions, self.session, self._choose_session, width=width)
        names = self._names()
        if names:
            self.episode = self.episode if self.episode in names else names[-1]
            menu_style.choice(menu, "Episode", names, self.episode, self._choose, width=width)
            menu_style.button(menu, "Watch", self.load, main=True)
            menu_style.button(menu, "Run the actions again", self.check)
            if self.job is not None:
                menu_style.note(menu, self._verdict(), width)

    def _names(self) -> list[str]:
        try:
            with open_session(self.shop.folder / self.session) as session:
                return list(session.names)
        except (ValueError, OSError) as error:
            self.shop.say(str(error), style.WARNING)
            return []

    def _choose_session(self, name: str) -> None:
        if name != self.session:
            self.session, self.episode = name, ""
            self._rebuild = True

    _rebuild: bool = False

    def _choose(self, name: str) -> None:
        self.episode = name

    def load(self) -> None:
        """Show the chosen episode from its beginning."""
        try:
            with open_session(self.shop.folder / self.session) as session:
                recorded = session.episode(self.episode)
        except (ValueError, OSError) as error:
            self.shop.say(str(error), style.WARNING)
            return
        found = checked_playback(f"{self.session} {self.episode}", recorded)
        if isinstance(found, str):
            self.shop.say(found, style.WARNING)
            return
        self.playback, self.at, self.playing, self.menu = found, 0, True, None
        self.shop.say(f"{self.episode} of {self.session}")

    def check(self) -> None:
        """Run the recorded actions once more, as `layflat replay --mode action` does."""
        if self.job is not None:
            self.job.close()
        number = str(demo_number(self.episode))
        self.job = SubprocessCommand(
            ["replay", str(self.shop.folder / self.session), "--episode", number, "--mode", "action"]
        )
        self.shop.say(f"running the actions of {self.episode} again")
        self._rebuild = True

    def _verdict(self) -> str:
        if self.job is None:
            return ""
        if self.job.status is None:
            return f"{self.job.doing or 'running the actions again'}…"
        return "\n".join(self.job.lines) or self.job.outcome()

    def leave(self) -> None:
        if self.job is not None:
            self.job.close()
            self.job = None
        self.playback, self.playing = None, False

    def update(self) -> None:
        if self.job is not None and self.job.status is not None and self.shop.message.startswith("running the actions"):
            self.shop.say(" ".join(self.job.lines) or self.job.outcome(), style.CONTACT)
            self._rebuild = self.menu is not None
        if self._rebuild and self.menu is not None:
            self._rebuild = False
            self.build()
        now = time.monotonic()
        if self.playback is None or not self.playing or now < self._due_s:
            return
        self._due_s = max(self._due_s, now - 0.05) + self.playback.episode.step_s
        self.at = min(self.at + 1, self.playback.last)
        self.playing = self.at < self.playback.last

    def to(self, number: int) -> None:
        """Show a moment, and stay there."""
        if self.playback is not None:
            self.at, self.playing = min(max(number, 0), self.playback.last), False

    def _play(self) -> None:
        if self.playback is not None:
            if self.at == self.playback.last and not self.playing:
                self.at = 0
            self.playing = not self.playing

    def _step(self, by: int) -> None:
        self.to(self.at + by)

    def _back(self) -> None:
        self.playback, self.playing = None, False
        self.build()

    def handle(self, event: pygame.event.Event) -> bool:
        if self.playback is None:
            return False
        if event.type == pygame.KEYDOWN:
            acts = {
                pygame.K_SPACE: self._play,
                pygame.K_LEFT: lambda: self._step(-1),
                pygame.K_RIGHT: lambda: self._step(1),
                pygame.K_HOME: lambda: self.to(0),
                pygame.K_END: lambda: self.to(10**9),
                pygame.K_ESCAPE: self._back,
            }
            if event.key in acts:
                acts[event.key]()
                return True
            return False
        return self._scrub(event)

    def _scrub(self, event: pygame.event.Event) -> bool:
        """The bar at the bottom of the view follows the mouse."""
        bar = self.bar()
        if event.type == pygame.MOUSEBUTTONDOWN and event.button == 1 and bar.collidepoint(event.pos):
            self._scrubbing = True
        elif event.type == pygame.MOUSEBUTTONUP:
            was, self._scrubbing = self._scrubbing, False
            return was
        if self._scrubbing and event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEMOTION) and self.playback:
            share = (event.pos[0] - bar.left - 16) / max(bar.width - 32, 1)
            self.to(round(share * self.playback.last))
            return True
        return False

    def bar(self) -> pygame.Rect:
        """Where the mouse scrubs, in the window."""
        view = self.shop.place.view
        return pygame.Rect(view.left, view.bottom - SCRUB_PX, view.width, SCRUB_PX)

    def paint_over(self, surface: pygame.Surface) -> None:
        """The bar, on the view."""
        if self.playback is None:
            return
        width, height = surface.get_size()
        veil = pygame.Surface((width, SCRUB_PX), pygame.SRCALPHA)
        veil.fill((*style.GROUND, 170))
        surface.blit(veil, (0, height - SCRUB_PX))
        y, left, right = height - SCRUB_PX // 2, 16, width - 16
        x = left + round(self.at / max(self.playback.last, 1) * (right - left))
        pygame.draw.line(surface, style.LINE, (left, y), (right, y), 4)
        pygame.draw.line(surface, style.ACCENT, (left, y), (x, y), 4)
        pygame.draw.circle(surface, style.TEXT, (x, y), 8)

    def chips(self) -> list[KeyHint]:
        if self.playback is None:
            return [KeyHint("Enter", "choose and press in the menu"), KeyHint("mouse", "turn, zoom and shift the view")]
        return [
            KeyHint("Space", "pause" if self.playing else "play", self._play, style.ACCENT),
            KeyHint("Left", "one step back", lambda: self._step(-1)),
            KeyHint("Right", "one step on", lambda: self._step(1)),
            KeyHint("Home", "to the start", lambda: self.to(0)),
            KeyHint("End", "to the end", lambda: self.to(10**9)),
            KeyHint("drag the bar", "go through it"),
            KeyHint("Esc", "to the menu", self._back),
        ]

    def headline(self) -> tuple[str, style.Colour]:
        return (self.episode, style.ACCENT) if self.playback is not None else (self.name, style.TEXT)

    def rows(self) -> list[FormRow]:
        if self.playback is None:
            return []
        moment = self.moment()
        rows = [FormRow("moment", f"step {self.at} of {self.playback.last}, {moment.sim_s:.1f} s" if moment else "")]
        rows += [FormRow(name, value) for name, value in facts(self.playback.episode).items()]
        now = self.playback.befalls(self.at)
        return [*rows, FormRow("now", now, style.WARNING)] if now else rows

    def moment(self) -> BenchFrame | None:
        return None if self.playback is None else self.playback.moment(self.at)

    def history(self) -> tuple[TimeSeries, float | None]:
        moment = self.moment()
        if self.playback is None or moment is None:
            return self.past, None
        return self.playback.history, moment.sim_s
