"""A device beside a keyboard whose controls count as well: a pad that has gone must not be the only way to quit."""

from __future__ import annotations

from dataclasses import replace

from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, Teleoperator


class CombinedInput:
    """The device moves; both control."""

    def __init__(self, device: Teleoperator, keyboard: Teleoperator) -> None:
        self.name = device.name
        self._device = device
        self._keyboard = keyboard

    def poll(self) -> TeleopInput:
        reading = self._device.poll()
        return replace(reading, controls=(*reading.controls, *self._keyboard.poll().controls))

    def rumble(self, strength: float, seconds: float) -> None:
        self._device.rumble(strength, seconds)

    def help(self) -> tuple[Button, ...]:
        """Buttons that ask for the same are one line."""
        keys = {button.control: button.name for button in self._keyboard.help() if button.control is not None}
        return tuple(
            button._replace(name=f"{button.name} or {keys[button.control]}") if button.control in keys else button
            for button in self._device.help()
        )

    def close(self) -> None:
        self._device.close()
        self._keyboard.close()
