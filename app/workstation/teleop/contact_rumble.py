"""Signals when the cloth begins to touch the table, such as a rumble."""

from __future__ import annotations

from layflat.app.workstation.teleop.teleoperator import Teleoperator

CONTACT_MIN = 0.02
"""Contact portion from which the cloth touches; the camera counts up to 0.01 for a hanging cloth."""
RUMBLE_STRENGTH, RUMBLE_S = 0.6, 0.15


class ContactBegin:
    """Calls `begin` once each time contact begins."""

    def __init__(self) -> None:
        self._touching = True

    def update(self, contact_portion: float, n_steps: int) -> None:
        """Take the newest contact portion, and the number of steps of the demonstration."""
        before, self._touching = self._touching, contact_portion >= CONTACT_MIN
        if self._touching and not before and n_steps > 0:
            self.begin()

    def begin(self) -> None:
        """Give the signal."""
        raise NotImplementedError


class ContactRumble(ContactBegin):
    """Rumbles a device once each time contact begins."""

    def __init__(self, teleoperator: Teleoperator) -> None:
        super().__init__()
        self._teleoperator = teleoperator

    def begin(self) -> None:
        """Rumble."""
        self._teleoperator.rumble(RUMBLE_STRENGTH, RUMBLE_S)
