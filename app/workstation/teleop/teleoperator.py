"""Protocols of devices with which a person moves the robot."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput


class Button(NamedTuple):
    """One line of help."""

    name: str
    """Name on the device: "Cross", "left stick", "w s"."""
    text: str
    """Effect, for a person."""
    command: Command | None = None
    """Command that the button gives; None for motion and the like."""


@runtime_checkable
class Teleoperator(Protocol):
    """Device in a person's hands."""

    name: str
    """Name in records: gamepad, keyboard, mouse, kinesthetic."""

    def poll(self) -> TeleopInput:
        """Return the newest state and the commands since the last poll; never wait."""

    def rumble(self, strength: float, seconds: float) -> None:
        """Rumble with a strength of 0..1, where the device can; do nothing by default."""
        return

    def help(self) -> tuple[Button, ...]:
        """Return the effect of each button."""

    def close(self) -> None:
        """Release the device; may be called twice."""


@runtime_checkable
class WindowTeleoperator(Teleoperator, Protocol):
    """Device that needs the events of a window."""

    def on_event(self, event: Any) -> bool:
        """Handle one of pygame's events; return whether it was for this device."""

    def release_taps(self, acted_s: float) -> None:
        """Forget the taps of keys before the input of ``acted_s``, on which a step has acted."""
        return

    def band(self) -> tuple[tuple[int, int], tuple[int, int], float] | None:
        """Return where a drag began and where it is, and the length of one at full speed, px; None without one."""
        return None
