"""`layflat flatten`: files, rows, and (slow) that WORD flattens what stretching and chance do not."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from layflat.app.commands import flatten
from layflat.app.media.video import count_frames
from layflat.app.support.errors import LayflatError
from layflat.app.support.metrics import COLUMNS
from layflat.app.workers.episode_pool import EpisodeConfig, EpisodeFailure, run_episodes
from layflat.data.types import Episode
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS


@pytest.fixture
def faked(monkeypatch, make_episode) -> list[EpisodeConfig]:
    """The command without physics: made-up episodes of the jobs' seeds; the jobs are kept."""
    kept: list[EpisodeConfig] = []

    def run(jobs, *, workers):
        kept.extend(jobs)
        for job in jobs:
            yield make_episode(robot=job.robot, source=job.source, seed=job.seed, disturbed=False)

    monkeypatch.setattr(flatten, "run_episodes", run)
    return kept


def _call(**changes) -> list[Episode]:
    call = {"controller": "word", "descriptor": "word-axial", "episodes": 3, "seed": 4, "cloth": "napkin"}
    call |= {"video": None, "strip": None, "json": None, "workers": 1, "force": False}
    return flatten.flatten(**(call | changes))


def test_json_holds_the_shared_rows_and_their_mean(faked, tmp_path, capsys):
    path = tmp_path / "out.json"
    _call(controller="stretch-right", json=path)
    content = json.loads(path.read_text())
    rows = content["episodes"]
    assert content["schema"] == 1
    assert [row["seed"] for row in rows] == [4, 5, 6] == [start["seed"] for start in content["starts"]]
    assert all(tuple(row) == COLUMNS and row["policy"] == "stretch-right" for row in rows)
    finals = [row["contact_final"] for row in rows]
    assert content["summary"]["n"] == 3
    assert content["summary"]["contact_final"]["mean"] == pytest.approx(np.mean(finals))
    assert content["provenance"]["versions"]
    assert [job.cloth for job in faked] == ["napkin"] * 3
    out = capsys.readouterr().out
    assert "mean" in out
    assert "mesh final" in out


def test_one_episode_has_no_interval_and_keeps_no_images_unasked(faked, tmp_path):
    path = tmp_path / "out.json"
    _call(episodes=1, json=path)
    assert json.loads(path.read_text())["summary"]["contact_final"]["ci95"] == [None, None]
    assert not any(job.images for job in faked)


@pytest.fixture
def ended(monkeypatch, make_episode):
    """``ended(*endings)``: from now on the command's episodes end so: "done", "crashes" or Ctrl-C."""

    def script(*endings) -> None:
        def run(jobs, *, workers):
            for job, ending in zip(jobs, endings, strict=True):
                if ending is KeyboardInterrupt:
                    raise KeyboardInterrupt
                made = make_episode(robot=job.robot, source=job.source, seed=job.seed, disturbed=False)
                yield made if ending == "done" else EpisodeFailure(job=job, reason="its process ended with status -11")

        monkeypatch.setattr(flatten, "run_episodes", run)

    return script


def test_what_is_lost_is_told_and_the_others_are_written(ended, tmp_path, capsys):
    path = tmp_path / "out.json"
    ended("done", "crashes", "done")
    sentence = "1 of 3 episodes were lost: its process ended with status -11; the others are written"
    with pytest.raises(LayflatError, match=sentence):
        _call(json=path)
    content = json.loads(path.read_text())
    assert [row["seed"] for row in content["episodes"]] == [4, 6]
    assert content["lost"] == [{"seed": 5, "reason": "its process ended with status -11"}]
    out, err = capsys.readouterr()
    assert "mean" in out
    assert "seed 5: lost, its process ended with status -11" in err


def test_ctrl_c_keeps_what_is_finished_and_draws_nothing(ended, tmp_path, capsys):
    ended("done", "crashes", KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        _call(json=tmp_path / "out.json", video=tmp_path / "run.webm", strip=tmp_path / "run.png")
    assert [path.name for path in tmp_path.iterdir()] == ["out.json"]
    content = json.loads((tmp_path / "out.json").read_text())
    assert [row["seed"] for row in content["episodes"]] == [4]
    assert [failure["seed"] for failure in content["lost"]] == [5]
    assert "mesh final" in capsys.readouterr().out


def test_ctrl_c_before_anything_is_finished_writes_nothing(ended, tmp_path, capsys):
    ended("crashes", KeyboardInterrupt, "done")
    with pytest.raises(KeyboardInterrupt):
        _call(json=tmp_path / "out.json")
    assert not list(tmp_path.iterdir())
    assert capsys.readouterr().out == ""


@pytest.mark.slow
def test_word_flattens_what_stretching_and_chance_do_not(tmp_path: Path) -> None:
    """Seeds that nothing was tuned on."""
    final: dict[str, float] = {}
    true: dict[str, float] = {}
    for name in CONTROLLERS:
        jobs = [
            EpisodeConfig(robot="pickers", cloth="towel", seed=s, flatten=name, descriptor="word-axial")
            for s in (300, 301)
        ]
        runs = [run for run in run_episodes(jobs, workers=2) if isinstance(run, Episode)]
        assert len(runs) == len(jobs)
        final[name] = float(np.mean([run.contact()[-1] for run in runs]))
        true[name] = float(np.mean([run.final_ground_truth.contact_portion_true for run in runs]))
    assert true["word"] >= 0.98
    assert max(final["stretch-right"], true["stretch-right"]) < 0.95
    assert max(final["random"], true["random"]) < 0.85
    assert final["word"] >= 0.98


@pytest.mark.slow
def test_film_and_strip_show_the_first_seed(tmp_path: Path) -> None:
    video, strip = tmp_path / "run.webm", tmp_path / "run.png"
    (episode,) = _call(episodes=1, cloth="towel", video=video, strip=strip)
    assert count_frames(video) == len(episode.steps) + 1
    picture = cv2.imread(str(strip))
    assert picture.shape[1] > 5 * flatten.STRIP_WIDTH
    assert {path.name for path in tmp_path.iterdir()} == {"run.webm", "run.png"}
