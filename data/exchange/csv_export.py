"""Exports episodes as two tables of comma-separated values, for spreadsheets and other languages."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path

from layflat.data.atomic_files import atomic_path
from layflat.data.errors import DataError
from layflat.data.format.demo_info import DemoInfo
from layflat.data.robot import RobotSpec
from layflat.data.session.reader import Session
from layflat.data.types import Episode, GroundTruth, Observation, Step

EPISODES_CSV, STEPS_CSV = "episodes.csv", "steps.csv"
_INFO_COLUMNS = {
    "robot": "robot",
    "task": "task",
    "physics": "physics",
    "cloth": "cloth",
    "seed": "seed",
    "source": "source",
    "outcome": "outcome",
    "stopped_by": "stopped_by",
    "disturbance": "disturbance",
    "steps": "n_steps",
    "step_s": "step_s",
    "contact_start": "contact_start",
    "contact_final": "contact_final",
    "contact_final_true": "contact_true_final",
    "flat_area_final": "flat_area_final",
}
"""Columns of episodes.csv after the name, and the attribute of DemoInfo in each."""
EPISODE_COLUMNS = ("episode", *_INFO_COLUMNS)
_CORNERS = tuple(f"corner{corner}_{axis}_m" for corner in (1, 2) for axis in "xyz")
_HOLDER = tuple(f"holder_{axis}_m" for axis in "xyz")
_OBSERVATION = ("time_s", *_CORNERS, *_HOLDER, "word_x", "word_y", "word_strength", "contact_portion")
_GROUND_TRUTH = ("contact_portion_true", "flat_area")
_DISTURBANCE = (
    *(f"force_{axis}_n" for axis in "xyz"),
    "drag_node",
    *(f"drag_{axis}_m" for axis in "xyz"),
    "intervention",
)


def step_columns(robot: RobotSpec) -> tuple[str, ...]:
    """Return the columns of steps.csv; the actions are displacements in metres."""
    actions = tuple(f"{name}_m" for name in robot.action_names)
    stds = tuple(f"std_{name}" for name in actions)
    return ("episode", "step", "phase", *_OBSERVATION, *_GROUND_TRUTH, *actions, *stds, *_DISTURBANCE)


def export_csv(session: Session, folder: Path, *, names: Iterable[str] | None = None) -> int:
    """Write ``episodes.csv`` and ``steps.csv`` into ``folder``, which is created; return the number of steps.

    Numbers have as many digits as it takes to read back the same bits; unknown values are empty. Each episode has one
    more row than steps: the last, without phase and action, is the final observation. Images and cloth nodes are left
    out.
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
        episodes.writerow(EPISODE_COLUMNS)
        steps.writerow(step_columns(session.robot))
        for name in chosen:
            episodes.writerow(_episode_row(name, session.info(name)))
            steps.writerows(_step_rows(name, session.episode(name, images=False)))
    return sum(session.info(name).n_steps for name in chosen)


def _episode_row(name: str, info: DemoInfo) -> list[object]:
    # The csv module writes None as an empty cell, and floats by their repr.
    return [name, *(getattr(info, attribute) for attribute in _INFO_COLUMNS.values())]


def _step_rows(name: str, episode: Episode) -> Iterator[list[object]]:
    size = episode.robot.size
    for index, step in enumerate(episode.steps):
        std = [""] * size if step.action_std is None else step.action_std.tolist()
        before = [name, index, step.phase, *_observation(step.observation), *_ground_truth(step.ground_truth)]
        yield [*before, *step.action.tolist(), *std, *_disturbance(step)]
    final = [*_observation(episode.final_observation), *_ground_truth(episode.final_ground_truth)]
    yield [name, len(episode.steps), "", *final, *[""] * (2 * size + len(_DISTURBANCE))]


def _observation(observation: Observation) -> list[float]:
    return [
        float(observation.time_s),
        *observation.corner_positions.ravel().tolist(),
        *observation.holder_position.tolist(),
        *observation.word.tolist(),
        float(observation.word_strength),
        float(observation.contact_portion),
    ]


def _ground_truth(ground_truth: GroundTruth | None) -> list[object]:
    if ground_truth is None:
        return [""] * len(_GROUND_TRUTH)
    return [float(ground_truth.contact_portion_true), float(ground_truth.flat_area)]


def _disturbance(step: Step) -> list[object]:
    drag = [""] * 4 if step.drag is None else [step.drag.node, *step.drag.target_m.tolist()]
    return [*step.force_n.tolist(), *drag, int(step.intervention)]
