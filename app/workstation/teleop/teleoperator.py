"""Protocols of devices with which a person moves the robot, and a device beside a keyboard."""

from __future__ import annotations

from dataclasses import replace
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


class CombinedInput(Teleoperator):
    """Motion of a device, commands of it and a keyboard: a disconnected gamepad must not be the only way to quit."""

    def __init__(self, device: Teleoperator, keyboard: Teleoperator) -> None:
        self.name, self._device, self._keyboard = device.name, device, keyboard
        self.rumble = device.rumble  # type: ignore[method-assign]

    def poll(self) -> TeleopInput:
        """Return the device's motion with the commands of both."""
        newest, keys = self._device.poll(), self._keyboard.poll()
        return replace(
            newest,
            commands=(*newest.commands, *keys.commands),
            connected=newest.connected and keys.connected,
            problem=newest.problem or keys.problem,
        )

    def help(self) -> tuple[Button, ...]:
        """Return the device's buttons, with the key that gives the same command on the same line."""
        keys = {button.command: f" or {button.name}" for button in self._keyboard.help()} | {None: ""}
        return tuple(button._replace(name=button.name + keys.get(button.command, "")) for button in self._device.help())

    def close(self) -> None:
        """Release both."""
        self._device.close()
        self._keyboard.close()
