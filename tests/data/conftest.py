"""What the tests of the data package share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from layflat.data import SessionRecorder
from layflat.data.types import Episode


def _beginning(episode: Episode) -> Episode:
    first = episode.steps[0]
    return replace(
        episode,
        steps=(),
        final_observation=first.observation,
        final_ground_truth=first.ground_truth,
        outcome="partial",
        stopped_by="interrupted",
    )


@pytest.fixture(scope="session")
def beginning_of() -> Callable[[Episode], Episode]:
    """What was known of an episode before its first step."""
    return _beginning


def _prefix(episode: Episode, n_steps: int, **changes: object) -> Episode:
    """By hand, so that it is an independent truth for trimming and recovery."""
    after = [*episode.steps, None][n_steps]
    final = (
        (episode.final_observation, episode.final_ground_truth)
        if after is None
        else (after.observation, after.ground_truth)
    )
    values = {"outcome": "partial", "stopped_by": "crashed"} | changes
    return replace(
        episode, steps=episode.steps[:n_steps], final_observation=final[0], final_ground_truth=final[1], **values
    )


@pytest.fixture(scope="session")
def prefix_of() -> Callable[..., Episode]:
    """``prefix_of(episode, steps, **fields)``: what a recording that was cut off after these steps may hold."""
    return _prefix


@pytest.fixture
def make_session(tmp_path: Path, make_episode: Callable[..., Episode]) -> Callable[..., Path]:
    """``make_session(name, episodes, **options of the recorder)``: a finished session of these episodes."""

    def make(name: str, episodes: list[Episode], **options: object) -> Path:
        path = tmp_path / name
        first = episodes[0]
        options = {"robot": first.robot, "cloth": first.cloth, "keep_images": True} | options
        with SessionRecorder(path, **options) as recorder:
            for episode in episodes:
                recorder.keep(episode)
        return path

    return make
