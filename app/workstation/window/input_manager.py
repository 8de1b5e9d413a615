"""InputManager: the input of device and mouse, sent to the session once a frame."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pygame

from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.registry import make_window_teleoperator
from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.app.workstation.teleop.teleoperator import Button, WindowTeleoperator
from layflat.app.workstation.window.sound import ContactTone
from layflat.app.workstation.window.viewport import Viewport
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec


class InputManager:
    """The device in use, and the mouse in the view."""

    def __init__(
        self,
        client: SessionClient,
        viewport: Viewport,
        view: Callable[[], pygame.Rect],
        *,
        source: str,
        robot: RobotSpec,
        mapping: Path | None = None,
        scale: Callable[[], float] = lambda: 1.0,
    ) -> None:
        self._client = client
        self._viewport = viewport
        self._view = view
        self.newest: TeleopInput = zero_input(robot)
        """Newest input of the device."""
        self.tone = ContactTone()
        self._teleoperator: WindowTeleoperator | None = None
        self._rumble: ContactRumble | None = None
        if source:
            self._teleoperator = make_window_teleoperator(
                source, robot, ray=self._ray, corners=self._corners, mapping=mapping, scale=scale
            )
            self._rumble = ContactRumble(self._teleoperator)

    def _ray(self, at: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """Return the line of sight behind a pixel of the window."""
        view = self._view()
        return self._viewport.camera.ray((at[0] - view.left, at[1] - view.top), view.size)

    def _corners(self) -> FloatArray:
        frame = self._client.frame
        return np.full((2, 3), np.inf) if frame is None else frame.corners

    def close(self) -> None:
        """Close the device; may be called twice."""
        if self._teleoperator is not None:
            self._teleoperator.close()
        self._teleoperator = self._rumble = None
        self.tone.close()

    def uses_mouse(self) -> bool:
        """Return whether the device is the mouse in the view, which then does not drag the cloth."""
        return self._teleoperator is not None and self._teleoperator.name in ("mouse", "kinesthetic")

    def help(self) -> tuple[Button, ...]:
        """Return the effect of each button of the device."""
        return () if self._teleoperator is None else self._teleoperator.help()

    def band(self) -> tuple[tuple[int, int], tuple[int, int], float] | None:
        """Return where a drag of the device began and where it is, px of the window, and its length at full speed."""
        return None if self._teleoperator is None else self._teleoperator.band()

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Pass an event to the device; return whether it was for it.

        A press of the mouse is only for the device in the view: elsewhere it is on a button.
        """
        if event.type == pygame.MOUSEBUTTONDOWN and not self._view().collidepoint(event.pos):
            return False
        return self._teleoperator is not None and self._teleoperator.on_event(event)

    def send(self) -> None:
        """Send the newest input to the session."""
        client = self._client
        if self._teleoperator is not None:
            if client.frame is not None:
                self._teleoperator.release_taps(client.frame.input_s)
            self.newest = self._teleoperator.poll()
            for command in self.newest.commands:
                client.send_command(command)
        self._viewport.hand = self.newest.hand
        if not (client.alive and client.status.can_drag and not self.uses_mouse()):
            self._viewport.end_drag()
        if client.alive:
            client.send_input(self.newest, self._viewport.drag)
            for signal in (self._rumble, self.tone):
                if signal is not None:
                    signal.update(client.status.contact, client.status.steps)

    def describe(self) -> str:
        """Return the device's name or its problem, for a person."""
        return self.newest.device if self.newest.connected else self.newest.problem
