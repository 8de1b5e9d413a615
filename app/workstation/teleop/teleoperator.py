"""The seam between a device and the rest."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput


class Button(NamedTuple):
    """One line of help."""

    name: str
    """As the device calls it: "Cross", "left stick", "w s"."""
    does: str
    """What it does now, for a person."""
    control: Command | None = None
    """What it asks of the recording, whose ``does`` then knows what that means now; None: motion and the like."""


@runtime_checkable
class Teleoperator(Protocol):
    """A device in a person's hands."""

    name: str
    """As records have it: gamepad, keyboard, mouse, kinesthetic."""

    def poll(self) -> TeleopInput:
        """The newest state, and the controls since the last poll; never waits."""

    def rumble(self, strength: float, seconds: float) -> None:
        """Let the hands feel something, 0..1, where the device can."""

    def help(self) -> tuple[Button, ...]:
        """What each button does now."""

    def close(self) -> None:
        """Give the device back as it was; may be called twice."""


@runtime_checkable
class WindowTeleoperator(Teleoperator, Protocol):
    """A source that hears what happens in the window."""

    def on_event(self, event: Any) -> bool:
        """One of pygame's events; True where it was for this source."""
