"""InputManager: the input of device and mouse, sent to the activity once a frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pygame

from layflat.app.support.errors import format_error
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.registry import make_window_teleoperator
from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.app.workstation.teleop.teleoperator import Button, WindowTeleoperator
from layflat.app.workstation.window.context import WindowContext
from layflat.app.workstation.window.viewport import Viewport
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec


class InputManager:
    """The device in use, and the mouse in the view."""

    def __init__(self, context: WindowContext, viewport: Viewport) -> None:
        self.mapping: Path | None = None
        """Mapping of a gamepad that SDL does not know."""
        self.problem = ""
        """Why there is no device, one sentence."""
        self.newest: TeleopInput | None = None
        """Newest input of the device."""
        self._context = context
        self._viewport = viewport
        self._teleoperator: WindowTeleoperator | None = None
        self._rumble: ContactRumble | None = None

    def select(self, name: str, robot: RobotSpec) -> bool:
        """Open a device; return False and set `problem` where that fails."""
        self.release()
        try:
            self._teleoperator = make_window_teleoperator(
                name, robot, ray=self._ray, corners=self._corners, mapping=self.mapping
            )
        except Exception as error:
            self.problem, _ = format_error(error)
            return False
        self._rumble = ContactRumble(self._teleoperator)
        return True

    def _ray(self, at: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """Return the line of sight behind a pixel of the window."""
        view = self._context.layout.view
        return self._viewport.camera.ray((at[0] - view.left, at[1] - view.top), view.size)

    def _corners(self) -> FloatArray:
        frame = self._context.client.frame
        return np.full((2, 3), np.inf) if frame is None else frame.corners

    def release(self) -> None:
        """Close the device."""
        if self._teleoperator is not None:
            self._teleoperator.close()
        self._teleoperator = self._rumble = self.newest = None

    def uses_mouse(self) -> bool:
        """Return whether the device is the mouse in the view, which then does not drag the cloth."""
        return self._teleoperator is not None and self._teleoperator.name in ("mouse", "kinesthetic")

    def help(self) -> tuple[Button, ...]:
        """Return the effect of each button of the device."""
        return () if self._teleoperator is None else self._teleoperator.help()

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Pass an event to the device; return whether it was for it.

        A press of the mouse is only for the device in the view: elsewhere it is on a tab or a button.
        """
        if event.type == pygame.MOUSEBUTTONDOWN and not self._context.layout.view.collidepoint(event.pos):
            return False
        return self._teleoperator is not None and self._teleoperator.on_event(event)

    def send(self, *, accepts_drag: bool) -> None:
        """Send the newest input to the activity; ``accepts_drag``: the mouse may drag the cloth now."""
        client = self._context.client
        if self._teleoperator is not None:
            self.newest = self._teleoperator.poll()
            for command in self.newest.commands:
                self._context.send_command(command)
        self._viewport.hand = None if self.newest is None else self.newest.hand
        if not (client.alive and accepts_drag):
            self._viewport.end_drag()
        if not client.alive or client.robot is None:
            return
        client.send_input(self.newest or zero_input(client.robot), self._viewport.drag)
        if self._rumble is not None:
            status: dict[str, Any] = client.status
            self._rumble.update(float(status.get("contact", 0.0)), int(status.get("steps", 0)))

    def describe(self) -> str:
        """Return the device's name or its problem, for a person."""
        if self.newest is None:
            return ""
        return self.newest.device if self.newest.connected else self.newest.problem
