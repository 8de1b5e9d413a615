"""Exports to a LeRobot data set, version 3.0, with pyarrow alone, so that LeRobot need not be installed.

A frame holds the observation before a step and the action that followed. Ground truth (nodes, true contact, flat area)
is left out: every ``observation.*`` column is something that a policy may see. The observation after the last step has
no action and is left out, too. Numbers are float32, as LeRobot's policies expect them; images keep every bit (rgb as
PNG, depth as TIFF of float32 metres).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.atomic_files import atomic_folder
from layflat.data.errors import DataError
from layflat.data.exchange.idle_end import kept_steps
from layflat.data.exchange.lerobot_card import CARD, card
from layflat.data.exchange.lerobot_features import Feature, camera_text, features_of, frames_of
from layflat.data.exchange.lerobot_stats import Stats
from layflat.data.exchange.lerobot_tables import (
    CHUNKS_SIZE,
    DATA_FILE_MB,
    DATA_PATH,
    DataFiles,
    EpisodeTable,
    write_tasks,
)
from layflat.data.exchange.optional_imports import require
from layflat.data.format import schema
from layflat.data.session.reader import Session

CODEBASE_VERSION = "v3.0"
VIDEO_FILE_MB = 200
"""LeRobot's own limit; this export has no videos."""
INFO = "meta/info.json"
SHARED = (schema.ROBOT, schema.ACTION_AXES, schema.STEP_S, schema.DESCRIPTOR)
"""Attributes in which sessions of one export must agree; task, cloth and physics may differ."""


@dataclass(frozen=True, kw_only=True)
class TaskEpisodes:
    """Episodes of one session and the text of their task."""

    session: Session
    names: Sequence[str]
    task_text: str


@dataclass(frozen=True, kw_only=True)
class LeRobotOptions:
    """Content of an export."""

    images: bool = True
    """Include rgb where the first episode has it; then all episodes need it."""
    depth: bool = False
    """Include depth likewise. ACT and Diffusion take it for a further colour camera and fail."""
    trim_idle: bool = False
    """Keep one step of an episode's idle end."""
    licence: str = "unknown"
    """Licence of the data, an identifier of Hugging Face's."""


@dataclass(frozen=True, kw_only=True)
class LeRobotExport:
    """Result of an export."""

    episodes: int
    frames: int
    images: bool


def export_lerobot(
    sources: Sequence[TaskEpisodes],
    folder: Path,
    options: LeRobotOptions = LeRobotOptions(),
    *,
    on_episode: Callable[[str], None] | None = None,
) -> LeRobotExport:
    """Write a LeRobot data set to ``folder``, which replaces an earlier export completely or not at all.

    An episode that is there twice, by its content, is taken once. ``on_episode`` is called with the name of each
    finished episode.
    """
    require("pyarrow.parquet")
    if not any(source.names for source in sources):
        raise DataError("no episodes were chosen; there is nothing to export")
    _check_agreement([source.session for source in sources])
    if folder.is_dir() and any(folder.iterdir()) and not (folder / INFO).is_file():
        raise DataError(f"{folder} is not a LeRobot data set; choose another folder")
    step_s = sources[0].session.step_s
    fps = round(1.0 / step_s)
    if fps < 1 or abs(fps * step_s - 1.0) > 1e-9:
        raise DataError(f"a step is {step_s} s; LeRobot needs a whole number of frames per second")
    with atomic_folder(folder) as aside:
        return _write(sources, aside, options, fps=fps, on_episode=on_episode)


def _check_agreement(sessions: Sequence[Session]) -> None:
    first = sessions[0]
    for session in sessions[1:]:
        for key in SHARED:
            if session.shared[key] != first.shared[key]:
                raise DataError(
                    f"{session.path} has {key} {session.shared[key]} and {first.path} has {first.shared[key]};"
                    " export them one by one"
                )


def _write(
    sources: Sequence[TaskEpisodes],
    root: Path,
    options: LeRobotOptions,
    *,
    fps: int,
    on_episode: Callable[[str], None] | None,
) -> LeRobotExport:
    first = next(source for source in sources if source.names)
    cameras = {camera_text(source.session, name) for source in sources for name in source.names}
    camera = json.loads(min(cameras) or "{}") if len(cameras) == 1 else {}
    features = features_of(first.session, first.names[0], images=options.images, depth=options.depth, camera=camera)
    stats, table = Stats(), EpisodeTable()
    tasks: dict[str, int] = {}
    with DataFiles(root) as files:
        for source, name in _without_copies(sources):
            length = kept_steps(source.session, name, trim_idle=options.trim_idle)
            task = tasks.setdefault(source.task_text, len(tasks))
            columns = frames_of(source.session, name, features, n_steps=length)
            columns |= _indices(len(table.rows), table.frames, length, fps, task)
            place = files.write(features, columns)
            own = Stats()
            own.add(columns)
            stats.merge(own)
            seen_by = camera_text(source.session, name)
            info = source.session.info(name)
            table.add(info, length, task=source.task_text, place=place, camera=seen_by, stats=own)
            if on_episode is not None:
                on_episode(name)
    _write_meta(root, features, table, stats, list(tasks), fps=fps)
    text = card(features, table.rows, camera, fps=fps, trim_idle=options.trim_idle, licence=options.licence)
    (root / CARD).write_text(text, encoding="utf-8")
    with_images = any(feature.dtype == "image" for feature in features)
    return LeRobotExport(episodes=len(table.rows), frames=table.frames, images=with_images)


def _without_copies(sources: Sequence[TaskEpisodes]) -> Iterator[tuple[TaskEpisodes, str]]:
    """Yield the episodes, the first one of those with the same content."""
    seen = set[str]()
    for source in sources:
        for name, content in source.session.contents(source.names).items():
            if content not in seen:
                seen.add(content)
                yield source, name


def _indices(episode: int, first: int, count: int, fps: int, task: int) -> dict[str, NDArray[Any]]:
    frame = np.arange(count, dtype=np.int64)
    return {
        "timestamp": (frame / fps).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(count, episode, np.int64),
        "index": first + frame,
        "task_index": np.full(count, task, np.int64),
    }


def _write_meta(
    root: Path, features: tuple[Feature, ...], table: EpisodeTable, stats: Stats, tasks: Sequence[str], *, fps: int
) -> None:
    table.write(root)
    write_tasks(root, tasks)
    info = {
        "codebase_version": CODEBASE_VERSION,
        "fps": fps,
        "features": {feature.key: feature.described() for feature in features},
        "total_episodes": len(table.rows),
        "total_frames": table.frames,
        "total_tasks": len(tasks),
        "chunks_size": CHUNKS_SIZE,
        "data_files_size_in_mb": DATA_FILE_MB,
        "video_files_size_in_mb": VIDEO_FILE_MB,
        "data_path": DATA_PATH,
        "video_path": None,
        "robot_type": f"layflat-{table.rows[0]['robot']}",
        "splits": {"train": f"0:{len(table.rows)}"},
    }
    _write_json(root / INFO, info)
    _write_json(root / "meta/stats.json", stats.result())


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=4, allow_nan=False) + "\n", encoding="utf-8")
