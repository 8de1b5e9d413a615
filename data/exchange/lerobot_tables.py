"""Parquet files of a LeRobot data set: frames, episodes and tasks."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from layflat.data.exchange.lerobot_features import Feature, encoded
from layflat.data.exchange.lerobot_stats import Stats
from layflat.data.exchange.optional_imports import require
from layflat.data.format.demo_info import DemoInfo

CHUNKS_SIZE = 1000
"""Largest number of files in a chunk's folder."""
DATA_FILE_MB = 100
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_PATH = "meta/episodes/chunk-000/file-000.parquet"
TASKS_PATH = "meta/tasks.parquet"
OWN_COLUMNS = (
    *("success", "outcome", "stopped_by", "contact_final", "seed", "source", "disturbance", "uid"),
    *("robot", "task", "physics", "cloth"),
)
"""Attributes of DemoInfo in the table of episodes; LeRobot keeps columns that it does not know."""


class DataFiles:
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
            self._path = self._root / DATA_PATH.format(chunk_index=chunk, file_index=number)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = require("pyarrow.parquet").ParquetWriter(self._path, table.schema, compression="snappy")
        self._writer.write_table(table)
        return chunk, number

    def close(self) -> None:
        """Finish the file that is open."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def __enter__(self) -> DataFiles:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


@dataclass
class EpisodeTable:
    """Rows of meta/episodes."""

    frames: int = 0
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, info: DemoInfo, length: int, *, task: str, place: tuple[int, int], camera: str, stats: Stats) -> None:
        """Append an episode whose frames were written to ``place``."""
        row: dict[str, Any] = {
            "episode_index": len(self.rows),
            "tasks": [task],
            "length": length,
            "data/chunk_index": place[0],
            "data/file_index": place[1],
            "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **{name: getattr(info, name) for name in OWN_COLUMNS},
            "camera": camera,
        }
        for key, values in stats.result().items():
            row |= {f"stats/{key}/{name}": value for name, value in values.items()}
        self.rows.append(row)
        self.frames += length

    def write(self, root: Path) -> None:
        """Write the table."""
        path = root / EPISODES_PATH
        path.parent.mkdir(parents=True)
        table = require("pyarrow").Table.from_pylist(self.rows)
        require("pyarrow.parquet").write_table(table, path, compression="snappy")


def write_tasks(root: Path, tasks: Sequence[str]) -> None:
    """Write one column and an index named "task", with the metadata by which pandas finds the index."""
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
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks, pa.string())})
    table = table.replace_schema_metadata({"pandas": json.dumps(described)})
    require("pyarrow.parquet").write_table(table, root / TASKS_PATH)
