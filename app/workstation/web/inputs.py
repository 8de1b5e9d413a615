"""Inputs: what hands do, at a gamepad of this machine or at the scene in a browser."""

from __future__ import annotations

from dataclasses import replace

from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.gamepad import Gamepad
from layflat.app.workstation.teleop.registry import usable_source
from layflat.app.workstation.teleop.teleop_input import zero_input
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget

SOURCES = {
    "kinesthetic": "drag the arrows at the robot",
    "gamepad": "a gamepad at the machine that runs Layflat",
}
"""Teleoperators that work here; keys held down need the live window or a terminal."""


class Inputs:
    """The newest input of a session; used from one thread, since SDL has to be."""

    hand: FloatArray | None = None
    """Place to which a guiding hand draws the robot, in the robot's hand shape."""
    drag: DragTarget | None = None
    """Pull at the cloth."""
    _pad: Gamepad | None = None
    _rumble: ContactRumble | None = None

    def open(self, source: str, robot: RobotSpec) -> None:
        """Open the device of a source."""
        self.close()
        if source == "gamepad":
            self._pad = Gamepad(robot)
            self._rumble = ContactRumble(self._pad)

    def close(self) -> None:
        """Release everything."""
        if self._pad is not None:
            self._pad.close()
        self.hand = self.drag = self._pad = self._rumble = None

    def send(self, session: SessionClient) -> None:
        """Send the newest input to a session, with the commands of the gamepad's buttons."""
        if not session.alive or session.robot is None:
            return
        newest = zero_input(session.robot) if self._pad is None else self._pad.poll()
        for command in newest.commands:
            session.send_command(command)
        teleop = newest.without_commands()
        if self.hand is not None and self.hand.shape == session.robot.hand_shape:
            teleop = replace(teleop, hand=self.hand)
        session.send_input(teleop, self.drag if session.status.can_drag else None)
        if self._rumble is not None:
            self._rumble.update(session.status.contact, session.status.steps)


def gamepad_plugged(robot: RobotSpec) -> bool:
    """Return whether there is a gamepad that can be used."""
    try:
        return usable_source("gamepad", robot)[0] == "gamepad"
    except Exception:
        return False
