"""What several viewers share: control, a session that ends beside the rounds, and what takes long."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.workstation import Workstation
from layflat.data.session.reader import open_session
from layflat.sim.config import SimConfig

NAPKIN = SimConfig(robot="hanger", cloth="napkin")


@dataclass
class Looker:
    """A viewer without a browser."""

    name: str
    said: list[str] = field(default_factory=list)

    def open(self, name: str) -> None: ...

    def say(self, text: str, level: str = "info") -> None:
        self.said.append(text)

    def update(self, *, whole: bool) -> None: ...


@pytest.fixture
def workstation(tmp_path) -> Iterator[Workstation]:
    made = Workstation(Folder(tmp_path), tmp_path, lambda _, client: Looker(f"viewer {client.client_id + 1}"))
    for number in range(2):
        made.connect(SimpleNamespace(client_id=number))
    yield made
    made.close()


def rounds(workstation: Workstation, until: Callable[[], object], seconds: float = 60.0) -> float:
    """Return the longest round, s."""
    give_up, longest = time.monotonic() + seconds, 0.0
    while not until():
        assert time.monotonic() < give_up
        began = time.monotonic()
        workstation.round()
        longest = max(longest, time.monotonic() - began)
    return longest


def test_of_several_viewers_one_is_in_control(workstation):
    workstation.require_control("viewer 1")
    assert not workstation.in_control("viewer 2")
    with pytest.raises(LayflatError, match="viewer 1 is in control; press Take control"):
        workstation.require_control("viewer 2")
    workstation.disconnect(1)
    assert workstation.holder == "viewer 1", "one who only watched has gone"
    workstation.take_control("viewer 2")
    assert not workstation.in_control("viewer 1")
    workstation.take_control("viewer 1")
    workstation.disconnect(0)
    assert workstation.in_control("viewer 3")


def test_a_session_ends_and_the_next_one_begins_while_the_rounds_go_on(workstation, tmp_path):
    """Saving a take and assembling the file are the session's own work: a round never waits for it."""
    request: dict[str, Any] = {"sim_config": NAPKIN, "source": "kinesthetic", "countdown_s": 0.0}
    session = workstation.session
    workstation.start(SessionRequest(session=tmp_path / "s.h5", **request))
    rounds(workstation, lambda: session.alive and session.status.ready)
    session.send_command(Command.START)
    rounds(workstation, lambda: session.status.state == "still")
    workstation.inputs.hand = session.frame.holder - [0.0, 0.0, 0.05]
    rounds(workstation, lambda: session.status.steps >= 3)
    first = session.pid
    workstation.start(SessionRequest(**request))
    assert session.pid == first, "it has not waited for the end"
    rounds(workstation, lambda: session.pid not in (first, None))
    assert [line.split()[2] for line in workstation.viewers[0].said if line.startswith("kept")] == ["partial"]
    workstation.stop()
    assert session.alive
    rounds(workstation, lambda: not session.alive)
    with open_session(tmp_path / "s.h5") as found:
        assert [info.outcome for info in found.infos().values()] == ["partial"]


def test_what_takes_long_runs_beside_the_rounds_and_its_error_is_shown(workstation):
    go, done = threading.Event(), []
    workstation.work(lambda: go.wait(30), done.append, 0)
    workstation.work(lambda: 1 / 0, done.append, 1)
    rounds(workstation, lambda: workstation.viewers[1].said)
    assert "division by zero" in workstation.viewers[1].said[-1]
    assert not done
    go.set()
    rounds(workstation, lambda: done)
    assert done == [True]


def test_conditions_of_the_server_hold_for_takes_and_for_commands(workstation):
    workstation.conditions = {"mass_factor": 2.0, "camera_width_px": 160}
    workstation.start(SessionRequest(sim_config=NAPKIN))
    rounds(workstation, lambda: workstation.session.request is not None)
    assert workstation.session.request.sim_config == NAPKIN.under({"mass_factor": 2.0, "camera_width_px": 160})
    workstation.run("evaluate", ["evaluate", "nothing.npz", "--set", "depth_noise=9", "--out", "x"])
    rounds(workstation, lambda: not workstation.jobs["evaluate"].running)
    shown = workstation.jobs["evaluate"]
    assert shown.arguments[-4:] == ["--set", "mass_factor=2.0", "--set", "camera_width_px=160"]
