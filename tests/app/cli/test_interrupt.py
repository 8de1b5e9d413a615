"""Ctrl-C and kill -9 of the running program: what was reported as kept stays, and nothing is left that hinders."""

from __future__ import annotations

import json
import time
from functools import partial
from pathlib import Path

import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.data import repair, validate
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy import model_io
from layflat.tests.app.program import Program
from layflat.tests.factories import PICKERS

LONG = 20
"""Episodes that are asked for, far more than are waited for."""


@pytest.fixture
def start(start_program):
    return partial(start_program, "layflat.app.cli.main")


def start_recording(start, path: Path, episodes: int = LONG, *options: object) -> Program:
    return start(
        "record", path, "--robot", "pickers", "--cloth", "napkin", "--episodes", episodes, "--workers", 2, *options
    )


def sources(path: Path) -> list[str]:
    with open_session(path) as session:
        return [episode.source for episode in session.episodes()]


def check_may_be_recorded_again(path: Path, make_episode) -> None:
    count = len(sources(path))
    with SessionRecorder(path, robot=PICKERS, cloth="napkin") as recorder:
        recorder.save(make_episode(robot="pickers", cloth="napkin", disturbed=False, descriptor=DEFAULT_DESCRIPTOR))
    assert len(sources(path)) == count + 1
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_ctrl_c_keeps_what_was_kept(start, tmp_path, make_episode):
    path = tmp_path / "s.h5"
    program = start_recording(start, path)
    program.until("kept demo_0 ")
    program.interrupt()
    assert sources(path) == ["scripted"] * program.out.count("kept ")
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]
    check_may_be_recorded_again(path, make_episode)


@pytest.mark.slow
def test_kill_9_keeps_what_was_kept_and_leaves_no_worker(start, tmp_path, make_episode):
    path = tmp_path / "s.h5"
    program = start_recording(start, path)
    program.until("kept")
    time.sleep(4.0)  # So that something is running.
    program.kill()
    assert program.none_left()
    count = len(sources(path))
    assert count >= program.out.count("kept ")
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
    check_may_be_recorded_again(path, make_episode)


@pytest.mark.slow
def test_the_next_recording_reports_what_a_killed_one_left(start, tmp_path):
    path = tmp_path / "s.h5"
    program = start_recording(start, path)
    program.until(lambda: bool(list(path.parent.glob("*.parts/running-*.journal"))))
    time.sleep(4.0)
    program.kill()
    assert program.none_left()
    before = len(sources(path)) if list(path.parent.glob("*.parts/demo_*.h5")) or path.exists() else 0
    program = start_recording(start, path, 1, "--seed", 50)
    assert program.wait() == 0
    lines = program.out.splitlines()
    assert [line.split()[0] for line in lines] == ["kept"] * len(lines)
    assert any(" partial " in line for line in lines[:-1])
    assert len(sources(path)) == before + len(lines)
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


@pytest.mark.slow
def test_ctrl_c_writes_the_rows_of_the_finished_episodes(start, tmp_path):
    model_io.save(random_model("pickers", 20), tmp_path / "m.npz")
    rows, session = tmp_path / "rows.json", tmp_path / "s.h5"
    program = start("place", tmp_path / "m.npz", "--episodes", LONG, "--seed", 0, "--json", rows, "--record", session)
    program.until("seed 0")
    program.interrupt()
    episodes = json.loads(rows.read_text())["episodes"]
    assert [row["seed"] for row in episodes][:1] == [0]
    assert len(sources(session)) == len(episodes)


@pytest.mark.slow
def test_ctrl_c_while_training_leaves_no_model(start, tmp_path, make_episode):
    with SessionRecorder(tmp_path / "s.h5", robot=PICKERS, cloth="towel") as recorder:
        for seed in range(8):
            recorder.save(make_episode(robot="pickers", seed=seed, disturbed=False))
    program = start("train", tmp_path / "s.h5", tmp_path / "m.npz")
    program.until("training")
    time.sleep(1.0)
    program.interrupt()
    assert program.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["s.h5"]
