"""Ctrl-C and kill -9 of the running program: what was reported as kept stays, and nothing is left that hinders."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.data import repair, validate
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy import model_io
from layflat.sim.robots.registry import robot_spec

LONG = 20
"""Episodes that are asked for, far more than are waited for."""


@pytest.fixture
def start() -> Iterator:
    """``start(*arguments)``: the program, in a process group of its own; whatever still runs is ended."""
    running: list[subprocess.Popen] = []

    def run(*arguments: object) -> subprocess.Popen:
        child = subprocess.Popen(
            [sys.executable, "-u", "-m", "layflat.app.cli.main", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        running.append(child)
        return child

    yield run
    for child in running:
        if child.poll() is None:
            child.kill()
            child.communicate()


def _record(start, path: Path) -> subprocess.Popen:
    return start("record", path, "--robot", "pickers", "--cloth", "napkin", "--episodes", LONG, "--workers", 2)


def _until(stream, words: str) -> str:
    for line in stream:
        if words in line:
            return str(line)
    raise AssertionError(f"the program ended without saying {words!r}")


def _none_left(group: int, patience_s: float = 5.0) -> bool:
    """No process of the group runs any more (those that have ended but were not asked about do not count)."""
    give_up = time.monotonic() + patience_s
    while time.monotonic() < give_up:
        if not [p for p in psutil.process_iter(["status"]) if _runs_in(p, group)]:
            return True
        time.sleep(0.1)
    return False


def _runs_in(process: psutil.Process, group: int) -> bool:
    try:
        return process.info["status"] != psutil.STATUS_ZOMBIE and os.getpgid(process.pid) == group
    except (ProcessLookupError, psutil.NoSuchProcess):
        return False


def _sources(path: Path) -> list[str]:
    with open_session(path) as session:
        return [episode.source for episode in session.episodes()]


def _may_be_recorded_again(path: Path, make_episode) -> bool:
    count = len(_sources(path))
    with SessionRecorder(path, robot=robot_spec("pickers"), cloth="napkin") as recorder:
        recorder.save(make_episode(robot="pickers", cloth="napkin", disturbed=False, descriptor=DEFAULT_DESCRIPTOR))
    return len(_sources(path)) == count + 1 and [p.name for p in path.parent.iterdir()] == [path.name]


def test_ctrl_c_keeps_what_was_kept(start, tmp_path, make_episode):
    child = _record(start, tmp_path / "s.h5")
    assert _until(child.stdout, "kept").startswith("kept demo_0 ")
    os.killpg(child.pid, signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert child.returncode == 130
    assert err.splitlines()[-1].startswith("layflat: interrupted")
    assert "Traceback" not in err
    assert _none_left(child.pid)
    assert _sources(tmp_path / "s.h5") == ["scripted"] * (1 + out.count("kept "))
    assert [path.name for path in tmp_path.iterdir()] == ["s.h5"]
    assert _may_be_recorded_again(tmp_path / "s.h5", make_episode)


@pytest.mark.slow
def test_kill_9_keeps_what_was_kept_and_leaves_no_worker(start, tmp_path, make_episode):
    path = tmp_path / "s.h5"
    child = _record(start, path)
    _until(child.stdout, "kept")
    time.sleep(4.0)  # So that something is running.
    child.kill()
    child.wait()
    assert _none_left(child.pid)
    out = child.stdout.read()
    count = len(_sources(path))
    assert count >= 1 + out.count("kept ")
    report = repair(path)
    assert report.lost == ()
    assert len(report.recovered) >= 1
    with open_session(path) as session:
        assert len(session) == count + len(report.recovered)
        running = [session.info(name) for name in report.recovered]
    # Two workers: what they had finished but not handed over comes back whole, what they were at as partial.
    assert sum(info.outcome == "partial" for info in running) <= 2
    assert {info.source for info in running} == {"scripted"}
    assert validate(path) == ()
    assert _may_be_recorded_again(path, make_episode)


@pytest.mark.slow
def test_the_next_recording_tells_what_a_killed_one_left(start, tmp_path):
    path = tmp_path / "s.h5"
    child = _record(start, path)
    while not list(path.parent.glob("*.parts/running-*.journal")):
        time.sleep(0.1)
    time.sleep(4.0)
    child.kill()
    child.wait()
    assert _none_left(child.pid)
    child = start("record", path, "--robot", "pickers", "--cloth", "napkin", "--episodes", 1, "--seed", 50)
    out, _ = child.communicate(timeout=120)
    assert child.returncode == 0
    lines = out.splitlines()
    assert [line.split()[0] for line in lines] == ["kept"] * len(lines)
    assert any(" partial " in line for line in lines[:-1])
    kept_before = int(lines[0].split()[1].removeprefix("demo_"))
    assert len(_sources(path)) == kept_before + len(lines)
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


@pytest.mark.slow
def test_ctrl_c_writes_the_rows_of_the_episodes_that_are_finished(start, tmp_path):
    model_io.save(random_model("pickers", 20), tmp_path / "m.npz")
    rows, session = tmp_path / "rows.json", tmp_path / "s.h5"
    child = start("place", tmp_path / "m.npz", "--episodes", LONG, "--json", rows, "--record", session)
    _until(child.stderr, "seed 0")
    os.killpg(child.pid, signal.SIGINT)
    _, err = child.communicate(timeout=30)
    assert child.returncode == 130
    assert "Traceback" not in err
    assert _none_left(child.pid)
    episodes = json.loads(rows.read_text())["episodes"]
    assert [row["seed"] for row in episodes][:1] == [0]
    assert len(_sources(session)) == len(episodes)


@pytest.mark.slow
def test_ctrl_c_while_training_leaves_no_model(start, tmp_path, make_episode):
    with SessionRecorder(tmp_path / "s.h5", robot=robot_spec("pickers"), cloth="towel") as recorder:
        for seed in range(8):
            recorder.save(make_episode(robot="pickers", seed=seed, disturbed=False))
    child = start("train", tmp_path / "s.h5", tmp_path / "m.npz")
    _until(child.stderr, "training")
    time.sleep(1.0)
    os.killpg(child.pid, signal.SIGINT)
    out, err = child.communicate(timeout=30)
    assert (child.returncode, out) == (130, "")
    assert "Traceback" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["s.h5"]
