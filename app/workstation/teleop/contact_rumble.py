"""Lets the hands feel when the cloth begins to touch the table."""

from __future__ import annotations

from layflat.app.workstation.teleop.teleoperator import Teleoperator

TOUCHES = 0.02
"""Contact portion from which on the cloth touches; the camera counts up to 0.01 of a cloth that hangs."""
RUMBLE = 0.6
RUMBLE_S = 0.15


class ContactRumble:
    """Rumbles once each time contact begins."""

    def __init__(self, source: Teleoperator) -> None:
        self._source = source
        self._touching = True

    def see(self, contact_portion: float, n_steps: int) -> None:
        """The newest contact portion, and steps since the demonstration began."""
        touching = contact_portion >= TOUCHES
        if touching and not self._touching and n_steps:
            self._source.rumble(RUMBLE, RUMBLE_S)
        self._touching = touching
