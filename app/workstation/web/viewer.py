"""Viewer: one browser's pages, message line and scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import viser

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.status import Level
from layflat.app.workstation.web.guide import Guide
from layflat.app.workstation.web.monitor import Monitor
from layflat.app.workstation.web.scene import Scene
from layflat.app.workstation.web.stage import CENTRE, VIEWS, look_from
from layflat.app.workstation.web.widgets import put, sentence
from layflat.app.workstation.web.workstation import Workstation

TAB_STYLE = """<style>
div:has(> .lf-tabs) + div > div > div:first-child {{display: none}}
div:has(> .lf-tabs) + div button:nth-of-type({number}) {{background: #0f766e !important; color: #fff !important}}
</style><span class="lf-tabs"></span>"""
"""The library's row of buttons does not show which one is chosen."""


BESIDE_M = (0.0, 1.3, 0.0)
"""Place of the second of two scenes: the tables do not touch."""
FARTHER = 1.9
"""Factor on the camera's distance that brings both into view."""


class Shown(Protocol):
    """A page as a viewer needs it."""

    name: str

    def build(self) -> None:
        """Add the page's parts."""

    def update(self) -> None:
        """Show the newest numbers."""

    def frames(self) -> Sequence[SimulationFrame]:
        """Return what the scene shows: nothing new, one frame, or two side by side."""

    def close(self) -> None:
        """Handle that another page is shown."""


class Viewer:
    """One browser; used from the workstation's thread only."""

    def __init__(
        self, workstation: Workstation, client: viser.ClientHandle, pages: Mapping[str, Callable[[Viewer], Shown]]
    ) -> None:
        self.workstation = workstation
        self._pages = pages
        self.client = client
        self.name = f"viewer {client.client_id + 1}"
        self.page: Shown | None = None
        self.scene = Scene(client.scene)
        self.guide = Guide(workstation, self.scene, self.name)
        self.monitor = Monitor(client.gui)
        self._beside: Scene | None = None
        self._shown: Sequence[SimulationFrame] = ()
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
        self.shown_session = self.shown_episode = ""
        """Session and episode that were looked at last."""
        self._folder: viser.GuiFolderHandle | None = None

    # Reactions

    def on_click(self, handle: Any, work: Callable[[], None], *, control: bool = False) -> None:
        """Do something on each click; ``control``: only where this viewer is in control, or gets it."""
        handle.on_click(self.reaction(work, control=control))

    def on_change(self, handle: Any, work: Callable[[], None]) -> None:
        """Do something on each change by the person."""
        handle.on_update(self.reaction(work, by_person=True))

    def reaction(self, work: Callable[[], None], *, control: bool = False, by_person: bool = False) -> Any:
        """Return a callback that does something in the workstation's thread."""

        def guarded() -> None:
            if control:
                self.workstation.require_control(self.name)
            work()

        async def react(event: Any) -> None:
            if not by_person or event.client_id is not None:
                self.workstation.post(guarded, self.client.client_id)

        return react

    @property
    def in_control(self) -> bool:
        """Whether this viewer may change what runs."""
        return self.workstation.in_control(self.name)

    def _take_control(self) -> None:
        self.workstation.session.control.take(self.name, force=True)
        self.workstation.inputs.hand = self.workstation.inputs.drag = None
        self.workstation.note(f"{self.name} has taken control")

    def say(self, text: str, level: Level = "info") -> None:
        """Show a sentence above the page; an empty one clears it, and leaves its line, so that nothing moves."""
        put(self._message, content=sentence(text or "\N{NO-BREAK SPACE}", level))

    # Pages

    def open(self, name: str) -> None:
        """Show a page."""
        page = self._pages.get(name)
        if page is None:
            return
        self.close_page()
        self.say("")
        self.monitor.show(None)
        put(self._marked, content=TAB_STYLE.format(number=list(self._pages).index(name) + 1))
        self._folder = self.client.gui.add_folder(name)
        self.page = page(self)
        with self._folder:
            self.page.build()

    def rebuild(self) -> None:
        """Build the page again, after its files or choices have changed."""
        page, old = self.page, self._folder
        if page is None or old is None:
            return
        self._folder = self.client.gui.add_folder(page.name)
        old.remove()
        with self._folder:
            page.build()

    def close_page(self) -> None:
        """End what only the page shows."""
        if self.page is not None:
            self.page.close()
        if self._folder is not None:
            self._folder.remove()
        self.page = self._folder = None

    def _show(self, frames: Sequence[SimulationFrame]) -> None:
        self._shown = frames
        self.scene.show(frames[0])
        if len(frames) == 2:
            if self._beside is None:
                self._beside = Scene(self.client.scene, name="/beside", offset_m=BESIDE_M)
                middle = np.add(CENTRE, BESIDE_M) - np.array(BESIDE_M) / 2
                with self.client.atomic():
                    self.client.camera.position = middle + FARTHER * np.subtract(VIEWS["Reset"], CENTRE)
                    self.client.camera.look_at = middle
            self._beside.show(frames[1])
        elif self._beside is not None:
            self._beside.remove()
            self._beside = None
            look_from(self.client, "Reset")
        self.client.flush()  # viser would wait for more to send: up to two frames of the screen.

    def update(self, *, whole: bool) -> None:
        """Show the newest frame, and, where ``whole``, the newest numbers."""
        frames = () if self.page is None else self.page.frames()
        if frames and [id(frame) for frame in frames] != [id(frame) for frame in self._shown]:
            self._show(frames)
        self.guide.update(frames[0] if frames else None)
        if not whole or self.page is None:
            return
        control = self.workstation.session.control
        others = len(self.workstation.viewers) - 1
        if not self.in_control:
            text = f"{control.holder} is in control; you watch"
        else:
            text = f"you are in control; {others} more watching" if others and control.holder else ""
        put(self._control, content=sentence(text, "info" if self.in_control else "warning"))
        put(self._take, visible=not self.in_control)
        self.page.update()
