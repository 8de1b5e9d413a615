"""Contents: what the window shows, in words, and its inputs: a session, its device, and what each key does now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pygame

from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.registry import make_window_teleoperator
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.window import panels, style
from layflat.app.workstation.window.ghost import Ghost
from layflat.app.workstation.window.panels import Fact, KeyHint
from layflat.app.workstation.window.sound import ContactTone
from layflat.app.workstation.window.viewport import Viewport
from layflat.data.arrays import FloatArray

VIEW_KEYS = {pygame.K_F2: "side", pygame.K_F3: "top", pygame.K_F4: "front", pygame.K_F5: "reset"}
"""Presets of the view by their keys."""


class Inputs:
    """The device in use and the mouse in the view, whose newest input is sent to the session once a frame."""

    def __init__(self, request: SessionRequest, client: SessionClient, mapping: Path | None = None) -> None:
        robot = request.sim_config.robot_spec
        self.view, self.scale = pygame.Rect(0, 0, 1, 1), 1.0
        """Place of the view in the window, and scale of the window."""
        self.viewport, self.tone = Viewport(), ContactTone()
        self.newest: TeleopInput = zero_input(robot)
        """Newest input of the device."""
        self.device = make_window_teleoperator(
            request.source, robot, ray=self._ray, corners=self._corners, mapping=mapping, scale=lambda: self.scale
        )
        self._client, self._rumble = client, ContactRumble(self.device)

    def _ray(self, at: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """Return the line of sight behind a pixel of the window."""
        return self.viewport.camera.ray((at[0] - self.view.left, at[1] - self.view.top), self.view.size)

    def _corners(self) -> FloatArray:
        frame = self._client.frame
        return np.full((2, 3), np.inf) if frame is None else frame.corners

    def close(self) -> None:
        """Close the device; may be called twice."""
        self.device.close()
        self.tone.close()

    def can_drag(self) -> bool:
        """Return whether the mouse may pull at the cloth now; a device that is the mouse has it for itself."""
        return self._client.status.can_drag and self.device.name not in ("mouse", "kinesthetic")

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Pass an event to the device; return whether it was for it.

        A press of the mouse is only for the device in the view: elsewhere it is on a button.
        """
        elsewhere = event.type == pygame.MOUSEBUTTONDOWN and not self.view.collidepoint(event.pos)
        return not elsewhere and self.device.on_event(event)

    def send(self) -> None:
        """Send the newest input to the session."""
        client, viewport = self._client, self.viewport
        if client.frame is not None:
            self.device.release_taps(client.frame.input_s)
        self.newest = self.device.poll()
        for command in self.newest.commands:
            client.send_command(command)
        viewport.hand = self.newest.hand
        if not (client.alive and self.can_drag()):
            viewport.end_drag()
        client.send_input(self.newest, viewport.drag)
        for signal in (self._rumble, self.tone):
            signal.update(client.status.contact, client.status.steps)


@dataclass
class Contents:
    """The session, and everything that is shown beside it."""

    request: SessionRequest
    client: SessionClient
    inputs: Inputs
    ghost: Ghost
    actions: dict[str, Callable[[], None]]
    """What the keys of the window do: ``sound``, ``ghost``, ``full screen``, ``end``, and each preset of the view."""
    past: TimeSeries = field(default_factory=TimeSeries)

    @property
    def status(self) -> SessionStatus:
        """Newest status of the session."""
        return self.client.status

    def update(self) -> None:
        """Take the newest frame."""
        if self.client.frame is not None:
            self.past.add(self.client.frame)
            self.ghost.follow(self.client.frame)

    def frame(self) -> SimulationFrame:
        """Return the newest frame; before the first one, the cloth as it will hang."""
        config = self.request.sim_config
        return self.client.frame or initial_frame(config.robot, config.cloth)

    def key_hints(self) -> list[KeyHint]:
        """Return the effect of each button of the device now, and of the mouse."""
        drag, uses_mouse = self.inputs.can_drag(), self.inputs.device.name in ("mouse", "kinesthetic")
        return [
            *panels.device_hints(self.inputs.device.help(), self.status, self.client.send_command),
            *([KeyHint("drag the cloth", "pulls at it")] if drag else []),
            KeyHint(f"drag{' beside the robot' * uses_mouse}, wheel, middle", "turn, zoom, pan the view"),
        ]

    def window_hints(self) -> list[KeyHint]:
        """Return the keys of the window itself."""
        do = self.actions
        ghost = [KeyHint("G", f"good one {self.ghost.state}", do["ghost"])] if self.ghost.available else []
        return [
            *ghost,
            KeyHint("M", f"sound {'on' if self.inputs.tone.on else 'off'}", do["sound"]),
            KeyHint("Ctrl + -", "letters"),
            KeyHint("F11", "full screen", do["full screen"]),
            KeyHint("Esc", "end", do["end"]),
        ]

    def view_hints(self) -> list[KeyHint]:
        """Return the keys of the view."""
        return [KeyHint(pygame.key.name(key).upper(), name, self.actions[name]) for key, name in VIEW_KEYS.items()]

    def start_key(self) -> str:
        """Return the button that starts a demonstration."""
        return next((button.name for button in self.inputs.device.help() if button.command is Command.START), "start")

    def problem(self) -> str:
        """Return why the device is disconnected and what to do here, or nothing."""
        device = self.inputs.newest
        return "" if device.connected else device.problem.replace("use the keyboard", "record with --source keyboard")

    def message(self) -> tuple[str, style.Color]:
        """Return the newest sentence, and its colour."""
        if self.problem() and self.status.state != "paused":
            return self.problem(), style.WORD
        return self.status.message.text, panels.LEVELS[self.status.message.level]

    def facts(self) -> list[Fact]:
        """Return the numbers."""
        request, status, device = self.request, self.status, self.inputs.newest.device
        count = f", {status.n_episodes} in it" if status.n_episodes else ""
        place = f"{request.session.name}{count}" if request.session else "none"
        named = panels.facts(status, place=place, device="" if device in ("keyboard", "mouse") else device)
        return [*named, Fact("robot", f"{request.sim_config.robot}, {request.sim_config.cloth}")]
