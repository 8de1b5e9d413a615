"""A device beside a keyboard: a disconnected gamepad must not be the only way to quit."""

from __future__ import annotations

from dataclasses import replace

from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, Teleoperator


class CombinedInput:
    """Teleoperator that takes motion from the device, and commands from the device and the keyboard."""

    def __init__(self, device: Teleoperator, keyboard: Teleoperator) -> None:
        self.name = device.name
        self._device = device
        self._keyboard = keyboard

    def poll(self) -> TeleopInput:
        """Return the device's motion with the commands of both."""
        newest = self._device.poll()
        keys = self._keyboard.poll()
        return replace(
            newest,
            commands=(*newest.commands, *keys.commands),
            connected=newest.connected and keys.connected,
            problem=newest.problem or keys.problem,
        )

    def rumble(self, strength: float, seconds: float) -> None:
        """Rumble the device."""
        self._device.rumble(strength, seconds)

    def help(self) -> tuple[Button, ...]:
        """Return the device's buttons, with the key that gives the same command on the same line."""
        keys = {button.command: button.name for button in self._keyboard.help() if button.command is not None}
        return tuple(
            button._replace(name=f"{button.name} or {keys[button.command]}") if button.command in keys else button
            for button in self._device.help()
        )

    def close(self) -> None:
        """Release both."""
        self._device.close()
        self._keyboard.close()
