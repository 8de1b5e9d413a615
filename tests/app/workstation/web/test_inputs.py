"""A gamepad at the machine that runs the server, and hands in the scene, reach the session."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.web.inputs import Inputs, gamepad_plugged
from layflat.data.types import DragTarget
from layflat.sim.robots.registry import robot_spec

HANGER = robot_spec("hanger")


@dataclass
class SeenSession:
    """What a session is sent."""

    alive: bool = True
    robot: Any = HANGER
    status: SessionStatus = field(default_factory=lambda: SessionStatus(can_drag=True))
    commands: list[Command] = field(default_factory=list)
    newest: tuple[Any, ...] = ()

    def send_command(self, command: Command) -> None:
        self.commands.append(command)

    def send_input(self, *values: Any) -> float:
        self.newest = values
        return 0.0


def test_a_gamepad_moves_and_commands(plug):
    session, inputs = SeenSession(), Inputs()
    pad = plug()
    assert gamepad_plugged(HANGER)
    inputs.open("gamepad", HANGER)
    inputs.send(session)
    pad.axis("left_x", 1.0)
    pad.tap("cross")
    inputs.send(session)
    teleop, drag = session.newest
    assert HANGER.unpack(teleop.motion)[0].tolist() == [1.0, 0.0, 0.0]
    assert (drag, teleop.connected) == (None, True)
    assert session.commands == [Command.START]
    pad.unplug()
    inputs.send(session)
    assert not session.newest[0].connected
    assert "--" not in session.newest[0].problem, "no option of the command line on a page"
    inputs.close()


def test_without_a_gamepad_there_is_none():
    assert not gamepad_plugged(HANGER)


def test_a_hand_in_the_scene_is_sent_while_it_fits_the_robot():
    session, inputs = SeenSession(), Inputs()
    inputs.open("kinesthetic", HANGER)
    inputs.hand = np.full(HANGER.hand_shape, 0.2)
    inputs.drag = DragTarget(node=3, target_m=np.zeros(3))
    inputs.send(session)
    teleop, drag = session.newest
    assert teleop.moving
    assert np.array_equal(teleop.hand, inputs.hand)
    assert drag is inputs.drag
    session.status = SessionStatus(can_drag=False)
    session.robot = robot_spec("pickers")
    inputs.send(session)
    assert session.newest[0].hand is None, "a hand of another robot"
    assert session.newest[1] is None, "no pull where it has no effect"
