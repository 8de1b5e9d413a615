"""Contents: what the window shows, in words: a session, its device, and what each key does now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pygame

from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.window import panels, style
from layflat.app.workstation.window.ghost import Ghost
from layflat.app.workstation.window.input_manager import InputManager
from layflat.app.workstation.window.panels import Fact, KeyHint
from layflat.app.workstation.window.viewport import Viewport

VIEW_KEYS = {pygame.K_F2: "side", pygame.K_F3: "top", pygame.K_F4: "front", pygame.K_F5: "reset"}
"""Presets of the view by their keys."""


@dataclass
class Contents:
    """The session, and everything that is shown beside it."""

    request: SessionRequest
    client: SessionClient
    viewport: Viewport
    devices: InputManager
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

    def accepts_drag(self) -> bool:
        """Return whether the mouse may pull at the cloth now."""
        return self.status.can_drag and not self.devices.uses_mouse()

    def key_hints(self) -> list[KeyHint]:
        """Return the effect of each button of the device now, and of the mouse."""
        hints = panels.device_hints(self.devices.help(), self.status, self._send)
        if self.accepts_drag():
            hints.append(KeyHint("drag the cloth", "pulls at it"))
        left = "drag beside the robot" if self.devices.uses_mouse() else "drag"
        hints.append(KeyHint(f"{left}, wheel, middle", "turn, zoom, pan the view"))
        return hints

    def window_hints(self) -> list[KeyHint]:
        """Return the keys of the window itself."""
        do = self.actions
        ghost = [KeyHint("G", f"good one {self.ghost.state}", do["ghost"])] if self.ghost.available else []
        return [
            *ghost,
            KeyHint("M", f"sound {'on' if self.devices.tone.on else 'off'}", do["sound"]),
            KeyHint("Ctrl + -", "letters"),
            KeyHint("F11", "full screen", do["full screen"]),
            KeyHint("Esc", self.status.effect(Command.QUIT) or "end", do["end"]),
        ]

    def view_hints(self) -> list[KeyHint]:
        """Return the keys of the view."""
        return [KeyHint(pygame.key.name(key).upper(), name, self.actions[name]) for key, name in VIEW_KEYS.items()]

    def start_key(self) -> str:
        """Return the button that starts a demonstration."""
        return next((button.name for button in self.devices.help() if button.command is Command.START), "start")

    def _send(self, command: Command) -> None:
        self.client.send_command(command)

    def message(self) -> tuple[str, style.Color]:
        """Return the newest sentence, and its colour."""
        device = self.devices.newest
        if not device.connected and device.problem and self.status.state != "paused":
            return device.problem, style.WORD
        return self.status.message.text, panels.LEVELS[self.status.message.level]

    def facts(self) -> list[Fact]:
        """Return the numbers."""
        request, status, device = self.request, self.status, self.devices.newest.device
        count = f", {status.n_episodes} in it" if status.n_episodes else ""
        place = f"{request.session.name}{count}" if request.session else "none"
        named = panels.facts(status, place=place, device="" if device in ("keyboard", "mouse") else device)
        return [*named, Fact("robot", f"{request.sim_config.robot}, {request.sim_config.cloth}")]
