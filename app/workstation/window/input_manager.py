"""What the person's hands do, from device and mouse into the bench's mailbox, once a frame."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pygame

from layflat.app.support.errors import format_error
from layflat.app.workstation.teleop import Button, Teleoperator
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.registry import window_source
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.app.workstation.window.pages.page import Page, WindowContext
from layflat.app.workstation.window.viewport import Viewport
from layflat.data.arrays import FloatArray
from layflat.sim.robots.registry import robot_spec


class InputManager:
    """The device that is in use, and the mouse in the view."""

    def __init__(self, shop: WindowContext, pane: Viewport) -> None:
        self.mapping: Path | None = None
        """A pad's own mapping, for pads that SDL does not know."""
        self.problem = ""
        """Why there is no device, one sentence."""
        self.reading: TeleopInput | None = None
        """The newest."""
        self._shop = shop
        self._pane = pane
        self._source: Teleoperator | None = None
        self._touch: ContactRumble | None = None
        self._robot: str = "hanger"

    def use(self, name: str, robot: str) -> bool:
        """Take a device into the hands; False, and a ``problem``, where that cannot be."""
        self.drop()
        try:
            self._source = window_source(
                name, robot_spec(robot), ray=self._ray, corners=self._corners, mapping=self.mapping
            )
        except Exception as error:
            self.problem, _ = format_error(error)
            return False
        self._touch = ContactRumble(self._source)
        self._robot = robot
        return True

    def _ray(self, at: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """The line of sight behind a pixel of the window."""
        view = self._shop.place.view
        return self._pane.orbit.ray((at[0] - view.left, at[1] - view.top), view.size)

    def _corners(self) -> FloatArray:
        moment = self._shop.link.moment
        return np.full((2, 3), np.inf) if moment is None else moment.corners

    def drop(self) -> None:
        """Give the device back."""
        if self._source is not None:
            self._source.close()
        self._source = self._touch = self.reading = None

    def leads(self) -> bool:
        """Whether the device is the mouse in the view, which then does not pull at the cloth."""
        return self._source is not None and self._source.name in ("mouse", "kinesthetic")

    def help(self) -> tuple[Button, ...]:
        return () if self._source is None else self._source.help()

    def take(self, event: pygame.event.Event) -> bool:
        """One event of this frame; True where it was the device's.

        A press of the mouse is only the device's in the view: elsewhere it is on a tab or a button.
        """
        if event.type == pygame.MOUSEBUTTONDOWN and not self._shop.place.view.collidepoint(event.pos):
            return False
        on_event: Callable[[Any], bool] | None = getattr(self._source, "on_event", None)
        return on_event is not None and on_event(event)

    def put(self, mode: Page) -> None:
        """The newest of everything, for the bench."""
        link = self._shop.link
        if self._source is not None:
            self.reading = self._source.poll()
            for control in self.reading.controls:
                self._press(control)
        self._pane.lead = None if self.reading is None else self.reading.hand
        if not link.alive:
            self._pane.release_pull()
            return
        if not mode.pullable():
            self._pane.release_pull()
        link.put(self.reading or zero_input(robot_spec(self._robot)), self._pane.pull)
        if self._touch is not None:
            self._touch.see(float(link.status.get("contact", 0.0)), int(link.status.get("steps", 0)))

    def _press(self, control: Command) -> None:
        self._shop.link.ask("control", name=control.name)

    def told(self) -> str:
        """The device, for a person."""
        if self._source is None or self.reading is None:
            return ""
        return self.reading.device if self.reading.connected else self.reading.problem

    def close(self) -> None:
        self.drop()
