"""Monitor: the camera's picture and the curves, beside the scene."""

from __future__ import annotations

import time

import viser

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.web.widgets import Curves, blank, camera_image, put

WIDTH_PX = 300
PICTURE_S = 0.2
"""Shortest time between two pictures."""


class Monitor:
    """Panel of one viewer."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._panel = gui.add_panel(visible=False)
        with self._panel.add_tab("Camera"):
            self._picture = gui.add_image(blank(), format="jpeg")
            self._curves = Curves(gui, ("", "beside"))
        self._panel.dock_left()
        self._panel.set_width(WIDTH_PX)
        self._frame: SimulationFrame | None = None
        self._drawn_s = 0.0

    def show(self, frame: SimulationFrame | None, *series: TimeSeries) -> None:
        """Show a frame and its curves; hide the panel where there is no frame."""
        put(self._panel, visible=frame is not None)
        if frame is None:
            return
        self._curves.show(*series)
        now = time.monotonic()
        if frame is not self._frame and now - self._drawn_s >= PICTURE_S:
            self._frame, self._drawn_s = frame, now
            image = camera_image(frame)
            self._picture.image = blank() if image is None else image
