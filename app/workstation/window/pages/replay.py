"""ReplayPage: choose a session and an episode, and go through it step by step."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import pygame

from layflat.app.workstation.playback import Playback, episode_facts, open_playback
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.window import style
from layflat.app.workstation.window.context import FormRow, KeyHint
from layflat.app.workstation.window.pages.page import MENU_HINTS, Page
from layflat.data.format.schema import demo_number
from layflat.data.session.reader import open_session

BAR_PX = 34
"""Height of the bar at the bottom of the view."""
REPEATING = "repeating the actions"
END = 10**9


@dataclass
class ReplayPage(Page):
    """Page of recorded episodes."""

    name: str = "Replay"
    episode: str = ""
    playback: Playback | None = None
    at: int = 0
    """Number of the frame that is shown."""
    playing: bool = False
    command: SubprocessCommand | None = None
    """An action replay that checks the episode."""
    _due_s: float = 0.0
    _scrubbing: bool = False

    def build(self) -> None:
        """Make the menu."""
        form = self.session_form("Replay", "Session")
        names = self.episode_names() if form is not None else []
        if form is None or not names:
            return
        self.episode = self.episode if self.episode in names else names[-1]
        form.choice("Episode", names, self.episode, self._choose_episode)
        form.button("Watch", self.load, main=True)
        form.button("Repeat the actions", self.check)
        if self.command is not None:
            form.note(self._check_result(self.command))

    def choose_session(self, name: str) -> None:
        """Take another session."""
        if name != self.session:
            self.session, self.episode, self.rebuild = name, "", True

    def _choose_episode(self, name: str) -> None:
        self.episode = name

    def load(self) -> None:
        """Play the chosen episode from its start."""
        try:
            with open_session(self.context.folder / self.session) as session:
                recorded = session.episode(self.episode)
        except (ValueError, OSError) as error:
            self.context.show_message(str(error), style.WARNING)
            return
        playback = open_playback(f"{self.session} {self.episode}", recorded)
        if isinstance(playback, str):
            self.context.show_message(playback, style.WARNING)
            return
        self.playback, self.at, self.playing, self.menu = playback, 0, True, None
        self.context.show_message(f"{self.episode} of {self.session}")

    def check(self) -> None:
        """Repeat the recorded actions, as `layflat replay --mode action` does."""
        if self.command is not None:
            self.command.close()
        path, number = str(self.context.folder / self.session), str(demo_number(self.episode))
        self.command = SubprocessCommand(["replay", path, "--episode", number, "--mode", "action"])
        self.context.show_message(f"{REPEATING} of {self.episode}")
        self.rebuild = True

    def _check_result(self, command: SubprocessCommand) -> str:
        if command.running:
            return f"{command.activity or REPEATING}…"
        return "\n".join(command.lines) or command.outcome()

    def leave(self) -> None:
        """End an action replay, and forget the episode."""
        if self.command is not None:
            self.command.close()
            self.command = None
        self.playback, self.playing = None, False

    def update(self) -> None:
        """Show the next frame when it is due."""
        command = self.command
        if command is not None and not command.running and self.context.message.startswith(REPEATING):
            self.context.show_message(" ".join(command.lines) or command.outcome(), style.CONTACT)
            self.rebuild = True
        super().update()
        now = time.monotonic()
        if self.playback is None or not self.playing or now < self._due_s:
            return
        self._due_s = max(self._due_s, now - 0.05) + self.playback.episode.step_s
        self.at = min(self.at + 1, self.playback.last)
        self.playing = self.at < self.playback.last

    def show(self, number: int) -> None:
        """Show a frame, and stop there."""
        if self.playback is not None:
            self.at, self.playing = min(max(number, 0), self.playback.last), False

    def _play(self) -> None:
        if self.playback is not None:
            if self.at == self.playback.last and not self.playing:
                self.at = 0
            self.playing = not self.playing

    def _back(self) -> None:
        self.playback, self.playing = None, False
        self.build()

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Handle keys, and the mouse on the bar."""
        if self.playback is None:
            return False
        if event.type != pygame.KEYDOWN:
            return self._scrub(event, self.playback)
        actions: dict[int, Callable[[], None]] = {
            pygame.K_SPACE: self._play,
            pygame.K_LEFT: lambda: self.show(self.at - 1),
            pygame.K_RIGHT: lambda: self.show(self.at + 1),
            pygame.K_HOME: lambda: self.show(0),
            pygame.K_END: lambda: self.show(END),
            pygame.K_ESCAPE: self._back,
        }
        action = actions.get(event.key)
        if action is not None:
            action()
        return action is not None

    def _scrub(self, event: pygame.event.Event, playback: Playback) -> bool:
        """Let the bar at the bottom of the view follow the mouse."""
        bar = self.bar()
        if event.type == pygame.MOUSEBUTTONDOWN and event.button == 1 and bar.collidepoint(event.pos):
            self._scrubbing = True
        elif event.type == pygame.MOUSEBUTTONUP:
            scrubbed, self._scrubbing = self._scrubbing, False
            return scrubbed
        if self._scrubbing and event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEMOTION):
            share = (event.pos[0] - bar.left - 16) / max(bar.width - 32, 1)
            self.show(round(share * playback.last))
            return True
        return False

    def bar(self) -> pygame.Rect:
        """Return the place of the bar in the window."""
        view = self.context.layout.view
        return pygame.Rect(view.left, view.bottom - BAR_PX, view.width, BAR_PX)

    def draw_over(self, surface: pygame.Surface) -> None:
        """Draw the bar."""
        if self.playback is None:
            return
        width, height = surface.get_size()
        veil = pygame.Surface((width, BAR_PX), pygame.SRCALPHA)
        veil.fill((*style.BACKGROUND, 170))
        surface.blit(veil, (0, height - BAR_PX))
        y, left, right = height - BAR_PX // 2, 16, width - 16
        x = left + round(self.at / max(self.playback.last, 1) * (right - left))
        pygame.draw.line(surface, style.LINE, (left, y), (right, y), 4)
        pygame.draw.line(surface, style.ACCENT, (left, y), (x, y), 4)
        pygame.draw.circle(surface, style.TEXT, (x, y), 8)

    def key_hints(self) -> list[KeyHint]:
        """Return the effect of each key now."""
        if self.playback is None:
            return list(MENU_HINTS)
        return [
            KeyHint("Space", "pause" if self.playing else "play", self._play, style.ACCENT),
            KeyHint("Left", "one step back", lambda: self.show(self.at - 1)),
            KeyHint("Right", "one step forward", lambda: self.show(self.at + 1)),
            KeyHint("Home", "to the start", lambda: self.show(0)),
            KeyHint("End", "to the end", lambda: self.show(END)),
            KeyHint("drag the bar", "to any step"),
            KeyHint("Esc", "to the menu", self._back),
        ]

    def headline(self) -> tuple[str, style.Color]:
        """Return the episode's name."""
        return (self.episode, style.ACCENT) if self.playback is not None else (self.name, style.TEXT)

    def rows(self) -> list[FormRow]:
        """Return facts about the episode and the step."""
        frame = self.frame()
        if self.playback is None or frame is None:
            return []
        rows = [FormRow("time", f"step {self.at} of {self.playback.last}, {frame.sim_s:.1f} s")]
        rows += [FormRow(name, value) for name, value in episode_facts(self.playback.episode).items()]
        active = self.playback.active_disturbances(self.at)
        return [*rows, FormRow("now", active, style.WARNING)] if active else rows

    def frame(self) -> SimulationFrame | None:
        """Return the frame that is shown."""
        return None if self.playback is None else self.playback.frame(self.at)

    def series(self) -> tuple[TimeSeries, float | None]:
        """Return the curves of the episode, and the time of the frame."""
        frame = self.frame()
        if self.playback is None or frame is None:
            return self.past, None
        return self.playback.series, frame.sim_s
