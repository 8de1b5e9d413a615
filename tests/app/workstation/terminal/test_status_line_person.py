"""Usable demonstrations by a person who sees only the status line, with a gamepad, in the terminal's loop."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator

import numpy as np
import pytest

from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.teleop.gamepad import Gamepad
from layflat.app.workstation.terminal.display import TerminalDisplay, run_recording
from layflat.data.session.reader import open_session
from layflat.data.types import FLAT_AREA
from layflat.sim.config import SimConfig
from layflat.tests.factories import ROBOT_SPECS
from layflat.tests.virtual_pad import VirtualPad, plugged

TRAIL_M = 0.075
COVERS = 0.99
"""Share of the cloth's length between where its free edge lands and where the held one does."""
HOLD_STEPS = 12


class Layer:
    """Lowers the cloth until its free edge lands, moves forward, lays the rest down, drags, holds still.

    It knows the place of the robot, the contact portion and the length of the cloth.
    """

    def __init__(self, client: SessionClient, pad: VirtualPad, sides: tuple[str, ...], length_m: float) -> None:
        self._client = client
        self._pad = pad
        self._sides = sides
        self._length_m = length_m

    def acts(self) -> Iterator[None]:
        """Yield after each look at the status line."""
        while True:
            while self._client.status.state != "waiting" or not self._client.status.ready:
                yield
            self._stick(0, 0)
            self._pad.axis("r2", -1)
            self._pad.tap("cross")
            while self._client.status.state not in ("still", "running"):
                yield
            for step in (self._lower, self._trail, self._lay, self._drag, self._hold):
                yield from step()
            self._pad.tap("triangle")
            while self._client.status.state in ("still", "running"):
                yield

    def _lower(self) -> Iterator[None]:
        while self._client.frame.holder[2] > self._length_m + 0.03:
            self._stick(0, -1)
            yield

    def _trail(self) -> Iterator[None]:
        self._edge_m = self._client.frame.holder[0]
        while self._client.frame.holder[0] < self._edge_m + TRAIL_M:
            self._stick(0.9, -0.35)
            yield

    def _lay(self) -> Iterator[None]:
        self._pad.axis("r2", -0.6)
        while True:
            x, _, z = self._client.frame.holder
            if z < 0.009:
                return
            way = np.array([self._edge_m + COVERS * self._length_m - x, 0.005 - z])
            far = float(np.linalg.norm(way))
            self._stick(*way / far * min(1.0, max(far / 0.05, 0.3)))
            yield

    def _drag(self) -> Iterator[None]:
        self._pad.axis("r2", -1)
        best, since, began = 0.0, self._client.status.steps, self._client.status.steps
        while True:
            contact, n_steps = self._client.status.contact, self._client.status.steps
            if contact > best + 0.003:
                best, since = contact, n_steps
            if contact > 0.975 or n_steps - since > 25 or n_steps - began > 60:
                return
            self._stick(0.35 if contact < 0.93 else 0.2, 0)
            yield

    def _hold(self) -> Iterator[None]:
        self._stick(0, 0)
        until = self._client.status.steps + HOLD_STEPS
        while self._client.status.steps < until:
            yield

    def _stick(self, right: float, up: float) -> None:
        for side in self._sides:
            self._pad.axis(f"{side}_x", right)
            self._pad.axis(f"{side}_y", -up)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
def test_a_towel_is_laid_flat_with_the_sticks(robot, tmp_path):
    settings, path, client = SimConfig(robot=robot.name), tmp_path / "s.h5", SessionClient()
    sides = ("left", "right")[: robot.n_points]
    with plugged() as pad:
        gamepad = Gamepad(robot)
        client.start(SessionRequest(sim_config=settings, source="gamepad", session=path, episodes=2, countdown_s=0.5))
        acts = Layer(client, pad, sides, settings.cloth_spec.length_m).acts()

        def sleep(seconds: float) -> None:
            time.sleep(seconds)
            next(acts)

        run_recording(client, gamepad, TerminalDisplay(io.StringIO()), stopped=lambda: False, sleep=sleep)
        client.check()
        gamepad.close()
    with open_session(path) as session:
        infos = list(session.infos().values())
        assert all(np.ptp([step.action[-1] for step in episode.steps]) > 0.005 for episode in session)
    assert [(info.outcome, info.source) for info in infos] == [("success", "gamepad")] * 2
    assert min(info.flat_area_final for info in infos) > FLAT_AREA
