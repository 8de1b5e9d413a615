"""Replay: one episode, or two side by side on one time line."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.playback import Playback, episode_facts, open_playback
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.viewer import Page
from layflat.app.workstation.web.widgets import facts, mark, put
from layflat.data.format.schema import demo_number
from layflat.data.session.reader import open_session

NONE = "none"
PREVIOUS, BACK, PLAY, AHEAD, NEXT = "previous", "-1", "play / pause", "+1", "next"
SPEEDS = ("0.25x", "0.5x", "1x", "2x", "4x")


class ReplayPage(Page):
    """Page of recorded episodes."""

    name = "Replay"

    def build(self) -> None:
        self._playbacks: list[Playback] = []
        self._at, self._last, self._playing, self._due_s = 0, 0, False, 0.0
        self._session = self.session_choice()
        names = self.episode_names(self._session) if self._session else []
        if not names:
            return
        episode = self.viewer.shown_episode if self.viewer.shown_episode in names else names[-1]
        self._episode = self.choice("Episode", names, episode, lambda _: self._load())
        sessions = self.folder.sessions()
        self._other_session = self.choice("Beside it, of", sessions, self._session, self._choose_other)
        self._other = self.choice("Beside it", [NONE, *names], NONE)
        # Its options change with the session beside.
        self.viewer.on_change(self._other, self._load)
        self.gui.add_html(mark("step"))
        self._time = self.gui.add_slider("Step", 0, 1, 1, 0, hint="A click into the curves goes there, too.")
        self.viewer.on_change(self._time, lambda: self._jump(int(self._time.value)))
        self._moves = self.gui.add_button_group("", (PREVIOUS, BACK, PLAY, AHEAD, NEXT))
        self.viewer.on_click(self._moves, lambda: self._move(self._moves.value))
        self._events = self.gui.add_button_group("Go to", ("start", "end"))
        self.viewer.on_click(self._events, lambda: self._jump(self._moments().get(self._events.value, 0)))
        self._speed = self.choice("Speed", SPEEDS, "1x")
        self._loop = self.gui.add_checkbox("Loop", False)
        self._facts = self.gui.add_html("")
        self.button("Run the actions again", self._check, hint="Whether physics repeats the recording.")
        self._job = JobView(self.viewer, "replay")
        self._load()

    def _choose_other(self, session: str) -> None:
        self._other.options = (NONE, *self.episode_names(session))
        put(self._other, value=NONE)
        self._load()

    def _load(self) -> None:
        """Read the chosen episodes, and show their start."""
        self.viewer.shown_session, self.viewer.shown_episode = self._session, str(self._episode.value)
        self.viewer.say("")
        chosen = [(self._session, str(self._episode.value)), (str(self._other_session.value), str(self._other.value))]
        self.viewer.background(partial(read_playbacks, self.folder, chosen), self._begin)

    def _begin(self, playbacks: list[Playback]) -> None:
        self._playbacks = playbacks
        self._last = max(playback.last for playback in playbacks)
        put(self._time, max=max(self._last, 1))
        put(self._events, options=tuple(self._moments()))
        self._show(0)
        self._playing = True

    def _moments(self) -> dict[str, int]:
        """Return the steps that one wants to see, by what happens there."""
        found = {"start": 0}
        episode = self._playbacks[0].episode
        for record in episode.disturbances:
            found.setdefault(record.name, record.first_step)
        for name, happens in (("pulled", "drag"), ("you", "intervention")):
            steps = [k for k, step in enumerate(episode.steps) if getattr(step, happens)]
            found |= {name: steps[0]} if steps else {}
        return found | {"end": self._playbacks[0].last}

    def _jump(self, step: int) -> None:
        self._playing = False
        self._show(step)

    def _move(self, what: str) -> None:
        """Play, step, or go to another episode."""
        names = list(self._episode.options)
        if what in (BACK, AHEAD):
            self._jump(self._at + (1 if what == AHEAD else -1))
        elif what == PLAY:
            self._at = 0 if self._at >= self._last and not self._playing else self._at
            self._playing = not self._playing
        else:
            number = names.index(str(self._episode.value)) + (1 if what == NEXT else -1)
            if 0 <= number < len(names):
                put(self._episode, value=names[number])
                self._load()

    def _show(self, step: int) -> None:
        """Show a step of all episodes; each stays at its end."""
        if not self._playbacks:
            return
        self._at = min(max(step, 0), self._last)
        put(self._time, value=self._at)
        playback = self._playbacks[0]
        frame = playback.frame(self._at)
        text = {"time": f"step {self._at} of {self._last}, {frame.sim_s:.1f} s"}
        text |= {"contact, flat area": f"{100 * frame.contact:.0f} %, {frame.flat_area:.2f}"}
        text |= dict(episode_facts(playback.episode))
        if active := playback.active_disturbances(self._at):
            text["now"] = active
        put(self._facts, content=facts(text))

    def update(self) -> None:
        """Show the step that is due."""
        if not self._playbacks:
            return
        self._job.update()
        first, step_s = self._playbacks[0], self._playbacks[0].episode.step_s
        series = [playback.series for playback in self._playbacks]
        self.viewer.monitor(first.frame(self._at), *series, at_s=self._at * step_s, step_s=step_s)
        now, step_s = time.monotonic(), step_s / float(str(self._speed.value)[:-1])
        if not self._playing or now < self._due_s:
            return
        n_steps = max(int((now - self._due_s) / step_s), 1) if now - self._due_s < 1.0 else 1
        self._due_s = max(self._due_s, now - step_s) + n_steps * step_s
        self._show(self._at + n_steps)
        if self._at >= self._last:
            self._playing = bool(self._loop.value)
            self._at = 0 if self._playing else self._at

    def frames(self) -> Sequence[SimulationFrame]:
        """Return the step of each episode."""
        return tuple(playback.frame(self._at) for playback in self._playbacks)

    def _check(self) -> None:
        """Run the recorded actions again, as `layflat replay --mode action` does."""
        number = str(demo_number(str(self._episode.value)))
        self._job.start(["replay", str(self.folder.session(self._session)), "--episode", number, "--mode", "action"])


def read_playbacks(folder: Folder, chosen: Sequence[tuple[str, str]]) -> list[Playback]:
    """Return episodes by session and name; LayflatError where one cannot be shown."""
    found = []
    for session, name in chosen:
        if name == NONE:
            continue
        with open_session(folder.session(session)) as opened:
            playback = open_playback(f"{session} {name}", opened.episode(name))
        if isinstance(playback, str):
            raise LayflatError(playback)
        found.append(playback)
    return found
