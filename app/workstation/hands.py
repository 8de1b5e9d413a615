"""What the person's hands do, from device and mouse into the bench's mailbox, once a frame."""

from __future__ import annotations

import pygame

from app.workstation.benchpane import BenchPane
from app.workstation.inputs.reading import at_rest
from app.workstation.modes.mode import Mode, Shop


class Hands:
    """The device that is in use, and the mouse in the view."""

    def __init__(self, shop: Shop, pane: BenchPane) -> None:
        self._shop = shop
        self._pane = pane

    def take(self, events: list[pygame.event.Event]) -> None:
        """Events of this frame."""

    def put(self, mode: Mode) -> None:
        """The newest of everything, for the bench."""
        if not self._shop.link.alive:
            self._pane.release()
            return
        if not mode.pullable():
            self._pane.pull = None
        reading = at_rest("hanger" if self._shop.settings.task == "hanger" else "pickers")
        self._shop.link.put(reading, self._pane.pull)

    def told(self) -> str:
        """The device, for a person."""
        return ""

    def close(self) -> None:
        """Give the device back."""
