"""Exports episodes as two tables of comma-separated values, for spreadsheets and other languages."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.atomic_files import atomic_path
from layflat.data.columns import write_legend
from layflat.data.errors import DataError
from layflat.data.exchange.idle_end import kept_steps
from layflat.data.format import schema
from layflat.data.robot import RobotSpec
from layflat.data.session.reader import Session

EPISODES_CSV, STEPS_CSV = "episodes.csv", "steps.csv"
_INFO = (
    *("robot", "task", "physics", "cloth", "seed", "source", "outcome", "stopped_by", "disturbance", "n_steps"),
    *("step_s", "contact_start", "contact_final", "contact_final_true", "flat_area_final"),
)
"""Attributes of DemoInfo in episodes.csv, after the name."""
_MOMENT_COLUMNS = {
    "time_s": ("time_s",),
    "corner_positions": tuple(f"corner{corner}_{axis}_m" for corner in (1, 2) for axis in "xyz"),
    "holder_position": tuple(f"holder_{axis}_m" for axis in "xyz"),
    "word": ("word_x", "word_y"),
    "word_strength": ("word_strength",),
    "contact_portion": ("contact_portion",),
    schema.CONTACT_TRUE: ("contact_portion_true",),
    schema.FLAT_AREA: ("flat_area",),
}
_STEP_COLUMNS = {
    schema.FORCE: tuple(f"force_{axis}_n" for axis in "xyz"),
    schema.DRAG_NODE: ("drag_node",),
    schema.DRAG_TARGET: tuple(f"drag_{axis}_m" for axis in "xyz"),
    schema.INTERVENTION: ("intervention",),
}


def step_columns(robot: RobotSpec) -> dict[str, tuple[str, ...]]:
    """Return the columns of steps.csv after ``episode, step, phase``, by key of the rows; actions are in metres."""
    actions = tuple(f"{name}_m" for name in robot.action_names)
    stds = tuple(f"std_{name}" for name in actions)
    return {**_MOMENT_COLUMNS, schema.ACTION_M: actions, schema.ACTION_STD: stds, **_STEP_COLUMNS}


def export_csv(session: Session, folder: Path, *, names: Iterable[str] | None = None, trim_idle: bool = False) -> int:
    """Write ``episodes.csv``, ``steps.csv`` and their legend into a folder; return the number of steps.

    Numbers have as many digits as it takes to read back the same bits; unknown values are empty. Each episode has one
    more row than steps: the last, without phase and action, is the final observation. Images and cloth nodes are left
    out. With ``trim_idle`` steps.csv has only one step of an idle end; episodes.csv describes the whole recording.
    """
    chosen = tuple(session.names if names is None else names)
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    folder.mkdir(parents=True, exist_ok=True)
    with (
        atomic_path(folder / EPISODES_CSV) as episodes_path,
        atomic_path(folder / STEPS_CSV) as steps_path,
        episodes_path.open("x", newline="", encoding="utf-8") as episodes_file,
        steps_path.open("x", newline="", encoding="utf-8") as steps_file,
    ):
        episodes, steps = csv.writer(episodes_file), csv.writer(steps_file)
        columns = step_columns(session.robot)
        titles = {
            EPISODES_CSV: ["episode", *(name.removeprefix("n_") for name in _INFO)],
            STEPS_CSV: ["episode", "step", "phase", *chain.from_iterable(columns.values())],
        }
        episodes.writerow(titles[EPISODES_CSV])
        steps.writerow(titles[STEPS_CSV])
        count = 0
        for name in chosen:
            info = session.info(name)
            # The csv module writes None as an empty cell, and floats by their repr.
            episodes.writerow([name, *(getattr(info, attribute) for attribute in _INFO)])
            kept = kept_steps(session, name, trim_idle=trim_idle)
            steps.writerows(_step_rows(name, kept, session.rows(name, images=False), columns))
            count += kept
        write_legend(folder, titles, session.robot)
    return count


def _step_rows(
    name: str, n_steps: int, rows: Mapping[str, NDArray[Any]], columns: Mapping[str, tuple[str, ...]]
) -> Iterator[list[object]]:
    """Yield a row for each of the first ``n_steps`` steps and one for the observation after them."""
    rows = {key: values[: n_steps + (key in _MOMENT_COLUMNS)] for key, values in rows.items()}
    phases = [phase.decode() for phase in rows[schema.PHASE]]
    for index in range(len(phases) + 1):
        cells: list[object] = [name, index, phases[index] if index < len(phases) else ""]
        for key, titles in columns.items():
            if key in rows and index < len(rows[key]):
                cells += [_cell(key, value) for value in np.ravel(rows[key][index]).tolist()]
            else:
                cells += [""] * len(titles)
        yield cells


def _cell(key: str, value: float) -> float | str:
    """Return a number as it is, and an empty cell where there is no value."""
    return "" if value != value or (key == schema.DRAG_NODE and value < 0) else value
