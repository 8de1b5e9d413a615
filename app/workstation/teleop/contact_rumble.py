"""Rumble when the cloth begins to touch the table."""

from __future__ import annotations

from layflat.app.workstation.teleop.teleoperator import Teleoperator

CONTACT_MIN = 0.02
"""Contact portion from which the cloth touches; the camera counts up to 0.01 for a hanging cloth."""
RUMBLE_STRENGTH = 0.6
RUMBLE_S = 0.15


class ContactBegin:
    """Notices each beginning of contact."""

    def __init__(self) -> None:
        self._touching = True

    def update(self, contact_portion: float, n_steps: int) -> bool:
        """Take the newest contact portion and the number of steps of the demonstration; return whether it begins."""
        before, self._touching = self._touching, contact_portion >= CONTACT_MIN
        return self._touching and not before and n_steps > 0


class ContactRumble:
    """Rumbles a device once each time contact begins."""

    def __init__(self, teleoperator: Teleoperator) -> None:
        self._teleoperator = teleoperator
        self._begin = ContactBegin()

    def update(self, contact_portion: float, n_steps: int) -> None:
        """Take the newest contact portion, and the number of steps of the demonstration."""
        if self._begin.update(contact_portion, n_steps):
            self._teleoperator.rumble(RUMBLE_STRENGTH, RUMBLE_S)
