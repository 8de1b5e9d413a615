"""Rumble when the cloth begins to touch the table."""

from __future__ import annotations

from layflat.app.workstation.teleop.teleoperator import Teleoperator

CONTACT_MIN = 0.02
"""Contact portion from which the cloth touches; the camera counts up to 0.01 for a hanging cloth."""
RUMBLE_STRENGTH = 0.6
RUMBLE_S = 0.15


class ContactRumble:
    """Rumbles a device once each time contact begins."""

    def __init__(self, teleoperator: Teleoperator) -> None:
        self._teleoperator = teleoperator
        self._touching = True

    def update(self, contact_portion: float, n_steps: int) -> None:
        """Take the newest contact portion, and the number of steps of the demonstration."""
        touching = contact_portion >= CONTACT_MIN
        if touching and not self._touching and n_steps:
            self._teleoperator.rumble(RUMBLE_STRENGTH, RUMBLE_S)
        self._touching = touching
