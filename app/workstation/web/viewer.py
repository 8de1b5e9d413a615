"""Viewer: one browser's pages, message line and scene; and Page, the base of what it shows beside the scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import viser

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.status import Level
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.scene import Scene
from layflat.app.workstation.web.stage import VIEWS, look_from
from layflat.app.workstation.web.widgets import Monitor, put, sentence
from layflat.app.workstation.web.workstation import Workstation
from layflat.data.session.reader import open_session

T = TypeVar("T")
GUIDED = ("still", "running", "stopped")
"""States in which the robot follows a hand."""
STYLE = """<style>
div:has(> .lf-tabs) + div > div > div:first-child {{display: none}}
div:has(> .lf-tabs) + div button:nth-of-type({number}) {{background: #0f766e !important; color: #fff !important}}
@media (max-width: 600px) {{
.mantine-Paper-root:has(.lf-tabs), .mantine-Paper-root:has(.lf-tabs) div[style*="width: 20em"]
{{width: 100% !important; max-width: 100vw}}
.mantine-Paper-root:has(.lf-tabs) {{min-height: 58vh !important; max-height: 58vh !important}}
div:has(> div > div > canvas) {{height: 42vh !important}}
}}
</style><span class="lf-tabs"></span>"""
"""The library's row of buttons does not show which one is chosen, and its sheet on a phone hides the scene."""
BESIDE_M = (0.0, 1.3, 0.0)
"""Place of the second of two scenes: the tables do not touch."""
FARTHER = 1.9
"""Factor on the camera's distance that brings both into view."""


class Viewer:
    """One browser; used from the workstation's thread only."""

    def __init__(self, workstation: Workstation, client: viser.ClientHandle, pages: Mapping[str, type[Page]]) -> None:
        self.workstation = workstation
        self.client = client
        self.name = f"viewer {client.client_id + 1}"
        self.page: Page | None = None
        self.scene = Scene(client.scene)
        self.shown_session = self.shown_episode = ""
        """Session and episode that were looked at last."""
        self._pages = pages
        self._monitor = Monitor(client.gui)
        self._beside: Scene | None = None
        self._shown: Sequence[SimulationFrame] = ()
        self._folder: viser.GuiFolderHandle | None = None
        self._hands = (False, False)
        """Whether the cloth can be pulled, and the robot guided."""
        self._dark, self._asked = False, 0
        gui = client.gui
        self._control = gui.add_html("")
        self._take = gui.add_button("Take control", visible=False)
        self.on_click(self._take, self._take_control)
        self._marked = gui.add_html("")
        self._tabs = gui.add_button_group("Page", tuple(pages))
        self.on_click(self._tabs, lambda: self.open(self._tabs.value))
        self._message = gui.add_html("")
        views = gui.add_button_group("View", tuple(VIEWS))
        self.on_click(views, lambda: look_from(client, views.value))

    # Reactions

    def on_click(self, handle: Any, work: Callable[[], None], *, control: bool = False) -> None:
        """Do something on each click; ``control``: only where this viewer is in control, or gets it."""
        handle.on_click(self.reaction(work, control=control))

    def on_change(self, handle: Any, work: Callable[[], None]) -> None:
        """Do something on each change by the person."""
        handle.on_update(self.reaction(work, by_person=True))

    def reaction(self, work: Callable[[], None], *, control: bool = False, by_person: bool = False) -> Any:
        """Return a callback that does something in the workstation's thread."""

        async def react(event: Any) -> None:
            if not by_person or event.client_id is not None:
                self._post(work, self.client.client_id, control=control)

        return react

    def _post(self, work: Callable[[], None], client_id: int, *, control: bool = True) -> None:
        def guarded() -> None:
            if control:
                self.workstation.require_control(self.name)
            work()

        self.workstation.post(guarded, client_id)

    def background(self, job: Callable[[], T], done: Callable[[T], None], *, always: bool = False) -> None:
        """Do something that takes long, and then ``done`` with its result.

        Not where the page has changed meanwhile, nor, unless ``always``, where something newer was asked for.
        """
        self._asked += 1
        folder, number = self._folder, self._asked

        def finish(result: T) -> None:
            if self._folder is folder and (always or number == self._asked):
                with folder if folder is not None else self.client.atomic():
                    done(result)

        self.workstation.work(job, finish, self.client.client_id)

    def _take_control(self) -> None:
        self.workstation.take_control(self.name)
        self.workstation.note(f"{self.name} has taken control")

    def say(self, text: str, level: Level = "info") -> None:
        """Show a sentence above the page; an empty one clears it, and leaves its line, so that nothing moves."""
        put(self._message, content=sentence(text or "\N{NO-BREAK SPACE}", level))

    # Pages

    def open(self, name: str) -> None:
        """Show a page."""
        if name not in self._pages:
            return
        if self.page is not None:
            self.page.close()
        self.say("")
        self.monitor(None)
        put(self._marked, content=STYLE.format(number=list(self._pages).index(name) + 1))
        self.page = self._pages[name](self)
        self.rebuild()

    def rebuild(self) -> None:
        """Build the page, again after its files or choices have changed."""
        if self.page is None:
            return
        old, self._folder = self._folder, self.client.gui.add_folder(self.page.name)
        if old is not None:
            old.remove()
        with self._folder:
            self.page.build()

    def monitor(self, frame: SimulationFrame | None, *series: TimeSeries, **options: float | None) -> None:
        """Show a frame's camera picture and curves beside the scene; none hides them."""
        self._monitor.show(time.monotonic(), frame, *series, **options)

    def update(self, *, whole: bool) -> None:
        """Show the newest frame, and, where ``whole``, the newest numbers."""
        if self.page is None:
            return
        frames = self.page.frames()
        if frames and [id(frame) for frame in frames] != [id(frame) for frame in self._shown]:
            self._show(frames)
        self._offer_hands(frames[0] if frames else None)
        if not whole:
            return
        holder, in_control = self.workstation.holder, self.workstation.in_control(self.name)
        others = len(self.workstation.viewers) - 1
        text = f"{holder} is in control; you watch"
        if in_control:
            text = f"you are in control; {others} more watching" if others and holder else ""
        put(self._control, content=sentence(text, "info" if in_control else "warning"))
        put(self._take, visible=not in_control)
        if self._dark != self.workstation.settings.dark:
            self._dark = self.workstation.settings.dark
            configure_theme(self.client.gui, dark=self._dark)
        self.page.update()

    # The scene

    def _show(self, frames: Sequence[SimulationFrame]) -> None:
        self._shown = frames
        self.scene.show(frames[0])
        if len(frames) == 2:
            if self._beside is None:
                self._beside = Scene(self.client.scene, name="/beside", offset_m=BESIDE_M)
                look_from(self.client, "Reset", (0.0, BESIDE_M[1] / 2, 0.0), FARTHER)
            self._beside.show(frames[1])
        elif self._beside is not None:
            self._beside.remove()
            self._beside = None
            look_from(self.client, "Reset")
        self.client.flush()  # viser would wait for more to send: up to two frames of the screen.

    def _offer_hands(self, frame: SimulationFrame | None) -> None:
        """Let this viewer pull at the cloth and guide the robot while that has an effect."""
        session = self.workstation.session
        acts = frame is not None and frame is session.frame and session.alive and self.workstation.in_control(self.name)
        guides = acts and session.status.source == "kinesthetic" and session.status.state in GUIDED
        before, self._hands = self._hands, (acts and session.status.can_drag, guides)
        for name, offer, had, has in zip(
            ("drag", "hand"), (self.scene.let_drag, self.scene.let_guide), before, self._hands, strict=True
        ):
            if had != has:
                offer(partial(self._moved, name) if has else None)  # type: ignore[operator]

    def _moved(self, name: str, client_id: int, value: Any) -> None:
        self._post(lambda: setattr(self.workstation.inputs, name, value), client_id)


def configure_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Choose the theme of the page."""
    gui.configure_theme(dark_mode=dark, control_width="large", show_logo=False, show_share_button=False)


class Page:
    """One tab of one viewer. A page overrides what it needs."""

    name = ""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer = viewer
        self.workstation = viewer.workstation
        self.folder: Folder = viewer.workstation.folder
        self.gui: viser.GuiApi = viewer.client.gui

    def build(self) -> None:
        """Add the page's parts."""

    def update(self) -> None:
        """Show the newest numbers."""

    def frames(self) -> Sequence[SimulationFrame]:
        """Return what the scene shows, one or two frames: what runs, unless the page has something of its own."""
        frame = self.workstation.session.frame
        return () if frame is None else (frame,)

    def close(self) -> None:
        """Handle that another page is shown."""

    # Parts

    def note(self, text: str) -> None:
        """Add a sentence."""
        self.gui.add_html(sentence(text))

    def button(
        self, label: str, work: Callable[[], None], *, control: bool = False, color: Any = None, hint: str | None = None
    ) -> None:
        """Add a button; ``control``: it changes what all viewers share."""
        self.viewer.on_click(self.gui.add_button(label, color=color, hint=hint), work, control=control)

    def choice(
        self, label: str, options: Sequence[str], value: str = "", change: Callable[[str], None] = lambda _: None,
        hint: str | None = None,
    ) -> viser.GuiDropdownHandle[str]:  # fmt: skip
        """Add a list to choose from; the first option is taken where ``value`` is none of them."""
        first = value if value in options else options[0]
        handle = self.gui.add_dropdown(label, tuple(options), initial_value=first, hint=hint)
        # What a browser sends need not be one of the options.
        self.viewer.on_change(handle, lambda: change(handle.value) if handle.value in options else None)
        return handle

    def setting(self, name: str, handle: Any) -> None:
        """Keep the value of a part of the page as a setting of the workstation."""
        kind = type(getattr(self.workstation.settings, name))
        self.viewer.on_change(handle, lambda: self.workstation.change_settings(**{name: kind(handle.value)}))

    def session_choice(self) -> str:
        """Add a list of sessions; return the chosen one, or "" where there is none, which is then said."""
        names = self.folder.sessions()
        if not names:
            self.note("There is no session in this folder; record one first.")
            return ""
        return str(self.choice("Session", names, self.viewer.shown_session, self._choose_session).value)

    def _choose_session(self, name: str) -> None:
        self.viewer.shown_session, self.viewer.shown_episode = name, ""
        self.viewer.rebuild()

    def episode_names(self, session: str) -> list[str]:
        """Return the names of a session's episodes; none where it cannot be read, which is shown."""
        try:
            with open_session(self.folder.session(session)) as opened:
                return list(opened.names)
        except Exception as error:
            self.viewer.say(str(error), "error")
            return []
