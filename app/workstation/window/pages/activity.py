"""ActivityPage: base of pages that run an activity, such as recording or placing, with a person's device."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from layflat.app.workstation.session.intervention import YOU
from layflat.app.workstation.session.requests import ActivityRequest
from layflat.app.workstation.window import style
from layflat.app.workstation.window.input_manager import InputManager
from layflat.app.workstation.window.pages.page import Page


@dataclass
class ActivityPage(Page):
    """Page that starts an activity from its menu, and comes back to the menu when that has ended."""

    input_manager: InputManager = field(kw_only=True)
    running: bool = False
    finished: bool = False
    """Whether the activity has done everything, and the page still shows it."""

    @property
    def status(self) -> dict[str, Any]:
        """Newest status of the activity."""
        return self.context.client.status

    @property
    def state(self) -> str:
        """State of the activity; empty before its first status."""
        return str(self.status.get("state", ""))

    @property
    def human_in_control(self) -> bool:
        """Whether the person, not the policy, is in control."""
        return self.status.get("controller") == YOU

    def run(self, request: ActivityRequest) -> bool:
        """Open the device and start the activity; return False where there is no device, which is shown."""
        if request.source and not self.input_manager.select(request.source, request.sim_config.robot_spec):
            self.context.show_message(self.input_manager.problem, style.WARNING)
            return False
        self.menu, self.running, self.finished = None, True, False
        self.past.episode = -1
        self.context.client.frame = None
        self.context.client.start(request)
        return True

    def stop(self) -> None:
        """End the activity, with everything saved, and go back to the menu."""
        self._end()
        self._to_menu()

    def _end(self) -> None:
        for event in self.context.client.end():
            self.handle_activity_event(event)

    def _to_menu(self) -> None:
        message, color = self.context.message, self.context.message_color
        self.running, self.context.client.status = False, {}
        self.input_manager.release()
        self.build()
        if message:
            self.context.show_message(message, color)

    def leave(self) -> None:
        """End the activity, with everything saved."""
        self._end()
        super().leave()
        self.running = False
        self.input_manager.release()

    def on_event(self, events: list[dict[str, Any]]) -> None:
        """Handle events of the activity, and its end."""
        for event in events:
            self.handle_activity_event(event)
        if self.running and not self.context.client.alive and not self.finished:
            if self.context.client.problem:
                self.context.show_message(self.context.client.problem, style.WARNING)
            self._to_menu()

    def handle_activity_event(self, event: dict[str, Any]) -> None:
        """Handle one event of the activity."""

    def can_drag(self, *states: str) -> bool:
        """Return whether the mouse may drag the cloth in these states."""
        return self.running and not self.finished and not self.input_manager.uses_mouse() and self.state in states
