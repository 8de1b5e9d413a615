"""What `layflat place` writes of episodes that end, crash or are interrupted; the episodes themselves are drawn."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.commands import place, record
from layflat.app.support.errors import LayflatError
from layflat.app.support.metrics import COLUMNS
from layflat.app.workers import episode_pool
from layflat.app.workers.episode_pool import EpisodeFailure
from layflat.data import open_session, validate
from layflat.policy import model_io as model_files


def _beginning(episode):
    first = episode.steps[0]
    return replace(
        episode, steps=(), final_observation=first.observation, final_ground_truth=first.ground_truth,
        stopped_by="interrupted", outcome="partial",
    )  # fmt: skip


@pytest.fixture
def placed(tmp_path, monkeypatch, make_episode):
    """``placed(*endings, record=False)``: place one episode for each of "done", "crashes" and Ctrl-C; the folder.

    A crash comes after three steps, which the episode's journal has.
    """
    model_files.save(random_model("hanger", 20), tmp_path / "m.npz")

    def run(endings, asked):
        for number, (job, ending) in enumerate(zip(asked, endings, strict=True)):
            episode = make_episode(seed=job.seed, source=job.source, disturbed=False, descriptor="word-axial")
            if job.ticket is not None:
                journal = job.ticket.open(_beginning(episode))
                for step in episode.steps[:3] if ending == "crashes" else episode.steps:
                    journal.step(step)
                journal.close()
            if ending is KeyboardInterrupt:
                raise KeyboardInterrupt
            yield (
                number,
                EpisodeFailure(job=job, reason="its process ended with status -11") if ending == "crashes" else episode,
            )

    def call(*endings, recorded=False) -> Path:
        for module in (episode_pool, record):
            monkeypatch.setattr(module, "run_numbered", lambda asked, *, workers: run(endings, asked))
        place.place(
            tmp_path / "m.npz", episodes=len(endings), seed=7, disturb=None,
            record=tmp_path / "s.h5" if recorded else None,
            video=None, json=tmp_path / "rows.json", cloth=None, workers=1, force=False,
        )  # fmt: skip

    return call


def _rows(folder):
    return json.loads((folder / "rows.json").read_text())


def test_a_crashed_episode_has_a_row_with_its_reason(placed, tmp_path):
    with pytest.raises(LayflatError, match=r"1 of 3 episodes were lost.*status -11"):
        placed("done", "crashes", "done")
    told = _rows(tmp_path)
    assert told["lost"] == 1
    assert [(row["seed"], row["crashed"]) for row in told["episodes"]] == [(7, False), (8, True), (9, False)]
    crashed = told["episodes"][1]
    assert [key for key in crashed if key != "reason"] == list(COLUMNS) == list(told["episodes"][0])
    assert crashed["reason"] == "its process ended with status -11"
    assert (crashed["stopped_by"], crashed["contact_final"], crashed["disturbance"]) == ("crashed", None, "none")
    assert crashed["policy"] == told["episodes"][0]["policy"]


def test_what_a_crashed_episode_left_is_recorded_as_partial(placed, tmp_path):
    with pytest.raises(LayflatError, match="1 of 2"):
        placed("crashes", "done", recorded=True)
    assert validate(tmp_path / "s.h5") == ()
    with open_session(tmp_path / "s.h5") as session:
        told = [(info.seed, info.outcome, info.stopped_by, info.n_steps) for info in session.infos().values()]
    assert told == [(7, "partial", "crashed", 2), (8, "success", "threshold", 60)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.npz", "rows.json", "s.h5"]


def test_ctrl_c_keeps_what_is_finished_and_nothing_of_what_ran(placed, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        placed("done", KeyboardInterrupt, recorded=True)
    assert [row["seed"] for row in _rows(tmp_path)["episodes"]] == [7]
    with open_session(tmp_path / "s.h5") as session:
        assert [info.seed for info in session.infos().values()] == [7]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.npz", "rows.json", "s.h5"]


def test_ctrl_c_tells_what_was_lost_before_it(placed, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        placed("crashes", KeyboardInterrupt)
    told = _rows(tmp_path)
    assert [(row["seed"], row["crashed"]) for row in told["episodes"]] == [(7, True)]
    assert told["lost"] == 1


def test_ctrl_c_before_anything_is_finished_writes_nothing(placed, tmp_path, capsys):
    with pytest.raises(KeyboardInterrupt):
        placed(KeyboardInterrupt)
    assert [path.name for path in tmp_path.iterdir()] == ["m.npz"]
    assert capsys.readouterr().out == ""
