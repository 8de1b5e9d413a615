"""ActivityClient and its process: what arrives, how soon, and what is shown when the process dies."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
import psutil
import pytest

from layflat.app.workstation.session.activity_client import ActivityClient
from layflat.app.workstation.teleop.teleop_input import zero_input
from layflat.sim.config import SimConfig
from layflat.tests.app.workstation.fake_activity import STEP_S, FakeActivity, FakeRequest
from layflat.tests.factories import HANGER


@pytest.fixture
def client() -> Iterator[ActivityClient]:
    made = ActivityClient(FakeActivity)
    yield made
    made.end()


def start(client: ActivityClient, robot: str = "hanger", **options) -> psutil.Process:
    client.start(FakeRequest(sim_config=SimConfig(robot=robot), **options))
    return psutil.Process(client.pid)


def poll_until(client: ActivityClient, condition: Callable[[], object], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited {seconds} s: {client.status} {client.problem}"
        client.poll_events()
        time.sleep(0.005)


def run_until_steps(client: ActivityClient, **options) -> psutil.Process:
    process = start(client, **options)
    poll_until(client, lambda: client.status.get("steps"))
    return process


def test_an_input_acts_in_the_next_step(client):
    """Written at any moment between two steps, it is what the next step acts on."""
    run_until_steps(client)
    rng = np.random.default_rng(0)
    stamps = []
    for _ in range(25):
        time.sleep(float(rng.uniform(0.2, 1.8)) * STEP_S)
        # It is there when `send_input` returns, which a busy machine may delay after the stamp.
        stamps.append((client.send_input(zero_input(HANGER)), time.monotonic()))
    poll_until(client, lambda: client.status["steps"][-1][1] >= stamps[-1][0])
    delays = []
    for stamp, written in stamps:
        started, acted_on = next((started, acted) for started, acted in client.status["steps"] if started > written)
        assert acted_on >= stamp
        delays.append(started - stamp)
    # It waits for nothing but the rest of the step before.
    assert np.median(delays) <= STEP_S


def test_a_process_that_dies_is_reported_and_can_be_started_again(client):
    run_until_steps(client)
    client.request("die")
    poll_until(client, lambda: not client.alive)
    assert "SIGKILL" in client.problem
    assert "saved" in client.problem
    start(client)
    assert client.problem == ""
    poll_until(client, lambda: client.status.get("steps"))


@pytest.mark.parametrize(
    ("refuse", "request_name", "problem"),
    [(True, None, "this simulation cannot be made"), (False, "fail", "the cloth has diverged"), (False, "finish", "")],
)
def test_an_error_arrives_as_its_own_message_and_an_end_is_none(client, refuse, request_name, problem):
    start(client, refuse=refuse)
    if request_name:
        client.request(request_name)
    poll_until(client, lambda: not client.alive)
    assert client.problem == problem


@pytest.mark.parametrize("how", ["end", "SIGTERM"])
def test_an_end_waits_until_everything_is_saved(client, tmp_path, how):
    saves = tmp_path / "saved"
    process = run_until_steps(client, saves=saves)
    if how == "end":
        client.end()
    else:
        process.terminate()
        poll_until(client, lambda: not client.alive)
    assert saves.read_text() == "saved"
    assert not process.is_running()
    assert client.problem == ""


def test_a_new_request_ends_the_previous_process(client):
    first = start(client)
    start(client, robot="pickers")
    assert not first.is_running()
    poll_until(client, lambda: client.status.get("steps"))
