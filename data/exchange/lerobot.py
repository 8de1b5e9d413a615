"""Exports to a LeRobot data set, version 3.0, with pyarrow alone: lerobot needs a Python that PyBullet does not run on.

A frame holds the observation before a step and the action that followed. Ground truth (nodes, true contact, flat area)
is left out: every ``observation.*`` column is something that a policy may see. The observation after the last step has
no action and is left out, too. Numbers are float32, as LeRobot's policies expect them; images keep every bit (rgb as
PNG, depth as TIFF of float32 metres).
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.atomic_files import PART_SUFFIX
from layflat.data.errors import DataError
from layflat.data.exchange.lerobot_features import Feature, encoded, features_of, frames_of
from layflat.data.exchange.lerobot_stats import Stats
from layflat.data.exchange.optional_imports import require
from layflat.data.format.demo_info import DemoInfo
from layflat.data.session.reader import Session

CODEBASE_VERSION = "v3.0"
CHUNKS_SIZE = 1000
"""Largest number of files in a chunk's folder."""
DATA_FILE_MB = 100
VIDEO_FILE_MB = 200
"""LeRobot's own limits; this export has no videos."""
PATHS = {
    "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "episodes_path": "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
}
INFO = "meta/info.json"
SIDECAR = "meta/layflat.json"
"""Seeds, outcomes and sources, for which LeRobot has no place; LeRobot does not read this file."""


@dataclass(frozen=True, kw_only=True)
class LeRobotExport:
    """Result of an export."""

    episodes: int
    frames: int
    images: bool


def export_lerobot(
    session: Session,
    folder: Path,
    *,
    names: Iterable[str] | None = None,
    images: bool = True,
    on_episode: Callable[[str], None] | None = None,
) -> LeRobotExport:
    """Write a LeRobot data set to ``folder``, which replaces an earlier export completely or not at all.

    ``images`` includes the camera's images where the session has them; all chosen episodes need them, or none.
    ``on_episode`` is called with the name of each finished episode.
    """
    require("pyarrow.parquet")
    chosen = tuple(session.names if names is None else names)
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / INFO).is_file():
        raise DataError(f"{folder} is not a LeRobot data set; choose another folder")
    fps = round(1.0 / session.step_s)
    if fps < 1 or abs(fps * session.step_s - 1.0) > 1e-9:
        raise DataError(f"a step is {session.step_s} s; LeRobot needs a whole number of frames per second")
    aside = folder.with_name(f".{folder.name}.{os.getpid()}{PART_SUFFIX}")
    shutil.rmtree(aside, ignore_errors=True)
    try:
        export = _write(session, aside, chosen, fps=fps, images=images, on_episode=on_episode)
        _replace_folder(aside, folder)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return export


def _replace_folder(aside: Path, folder: Path) -> None:
    """Move the old folder out of the way first: a folder cannot replace a folder in one step."""
    old = folder.with_name(f".{folder.name}.{os.getpid()}.old")
    if folder.exists():
        os.replace(folder, old)
    os.replace(aside, folder)
    shutil.rmtree(old, ignore_errors=True)


def _write(
    session: Session,
    root: Path,
    names: tuple[str, ...],
    *,
    fps: int,
    images: bool,
    on_episode: Callable[[str], None] | None,
) -> LeRobotExport:
    task = f"Lay the {session.cloth} flat on the table with the {session.robot}."
    features = features_of(session, names[0], images=images)
    stats = Stats()
    meta = _EpisodeTable(task)
    with _DataFiles(root) as files:
        for index, name in enumerate(names):
            n_steps = session.info(name).n_steps
            columns = frames_of(session, name, features) | _indices(index, meta.frames, n_steps, fps)
            place = files.write(features, columns)
            own = Stats()
            own.add(columns)
            stats.merge(own)
            meta.add(index, n_steps, place, own)
            meta.describe(index, name, session.info(name))
            if on_episode is not None:
                on_episode(name)
    with_images = any(feature.dtype == "image" for feature in features)
    _write_meta(root, session, features, meta, stats, fps=fps)
    return LeRobotExport(episodes=len(names), frames=meta.frames, images=with_images)


def _indices(episode: int, first: int, count: int, fps: int) -> dict[str, NDArray[Any]]:
    frame = np.arange(count, dtype=np.int64)
    return {
        "timestamp": (frame / fps).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(count, episode, np.int64),
        "index": first + frame,
        "task_index": np.zeros(count, np.int64),
    }


class _DataFiles:
    """Writes data/chunk-*/file-*.parquet: one row group for each episode, a new file where one has become large."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._number = 0
        self._writer: Any = None
        self._path = root

    def write(self, features: tuple[Feature, ...], columns: Mapping[str, Any]) -> tuple[int, int]:
        """Append an episode; return the chunk's and the file's number."""
        table = encoded(features, columns)
        if self._writer is not None and self._path.stat().st_size >= DATA_FILE_MB << 20:
            self.close()
            self._number += 1
        chunk, number = divmod(self._number, CHUNKS_SIZE)
        if self._writer is None:
            self._path = self._root / PATHS["data_path"].format(chunk_index=chunk, file_index=number)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = require("pyarrow.parquet").ParquetWriter(self._path, table.schema, compression="snappy")
        self._writer.write_table(table)
        return chunk, number

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def __enter__(self) -> _DataFiles:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


@dataclass
class _EpisodeTable:
    """Rows of meta/episodes and of the sidecar."""

    task: str
    frames: int = 0
    rows: list[dict[str, Any]] = field(default_factory=list)
    descriptions: list[dict[str, Any]] = field(default_factory=list)

    def add(self, index: int, length: int, place: tuple[int, int], stats: Stats) -> None:
        row: dict[str, Any] = {
            "episode_index": index,
            "tasks": [self.task],
            "length": length,
            "data/chunk_index": place[0],
            "data/file_index": place[1],
            "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for key, values in stats.result().items():
            row |= {f"stats/{key}/{name}": value for name, value in values.items()}
        self.rows.append(row)
        self.frames += length

    def describe(self, index: int, name: str, info: DemoInfo) -> None:
        keys = ("uid", "seed", "source", "outcome", "stopped_by", "disturbance")
        self.descriptions.append({"episode_index": index, "name": name, **{key: getattr(info, key) for key in keys}})


def _write_meta(
    root: Path, session: Session, features: tuple[Feature, ...], meta: _EpisodeTable, stats: Stats, *, fps: int
) -> None:
    pa, parquet = require("pyarrow"), require("pyarrow.parquet")
    path = root / PATHS["episodes_path"].format(chunk_index=0, file_index=0)
    path.parent.mkdir(parents=True)
    parquet.write_table(pa.Table.from_pylist(meta.rows), path, compression="snappy")
    parquet.write_table(_tasks_table(meta.task), root / "meta/tasks.parquet")
    info = {
        "codebase_version": CODEBASE_VERSION,
        "fps": fps,
        "features": {feature.key: feature.described() for feature in features},
        "total_episodes": len(meta.rows),
        "total_frames": meta.frames,
        "total_tasks": 1,
        "chunks_size": CHUNKS_SIZE,
        "data_files_size_in_mb": DATA_FILE_MB,
        "video_files_size_in_mb": VIDEO_FILE_MB,
        "data_path": PATHS["data_path"],
        "video_path": None,
        "robot_type": f"layflat-{session.robot}",
        "splits": {"train": f"0:{len(meta.rows)}"},
    }
    _write_json(root / INFO, info)
    _write_json(root / "meta/stats.json", stats.result())
    _write_json(root / SIDECAR, {"schema": 1, **session.shared, "episodes": meta.descriptions})


def _tasks_table(task: str) -> Any:
    """Return one column and an index named "task", with the metadata by which pandas finds the index."""
    pa = require("pyarrow")
    text = {"field_name": "task", "name": "task", "numpy_type": "object", "pandas_type": "unicode", "metadata": None}
    number = {"field_name": "task_index", "name": "task_index", "numpy_type": "int64", "pandas_type": "int64"}
    described = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [{**number, "metadata": None}, text],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.2.0",
    }
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": pa.array([task], pa.string())})
    return table.replace_schema_metadata({"pandas": json.dumps(described)})


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=4, allow_nan=False) + "\n", encoding="utf-8")
