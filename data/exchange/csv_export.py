"""Episodes as two tables of comma-separated values, for spreadsheets and other languages."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

from layflat.data.arrays import FloatArray
from layflat.data.atomic_files import PART_SUFFIX, atomic_path
from layflat.data.errors import DataError
from layflat.data.robot import RobotSpec
from layflat.data.session.reader import Session
from layflat.data.types import Episode, Observation, Step

EPISODES_CSV, STEPS_CSV = "episodes.csv", "steps.csv"
EPISODE_COLUMNS = (
    "episode",
    "robot",
    "cloth",
    "seed",
    "source",
    "outcome",
    "stopped_by",
    "disturbance",
    "steps",
    "step_s",
    "contact_start",
    "contact_end",
    "contact_true_end",
    "flat_area_end",
)
_CORNERS = tuple(f"corner{corner}_{axis}_m" for corner in (1, 2) for axis in "xyz")
_HOLDER = tuple(f"holder_{axis}_m" for axis in "xyz")
_SEEN = ("time_s", *_CORNERS, *_HOLDER, "word_x", "word_y", "word_strength", "contact_portion")
_BEFELL = (*(f"force_{axis}_n" for axis in "xyz"), "pull_node", *(f"pull_{axis}_m" for axis in "xyz"), "intervention")
_TRUE = ("contact_portion_true", "flat_area")


def step_columns(robot: RobotSpec) -> tuple[str, ...]:
    """Columns of steps.csv; the actions are displacements in metres."""
    actions = tuple(f"{name}_m" for name in robot.action_names)
    stds = tuple(f"std_{name}" for name in actions)
    return ("episode", "step", "phase", *_SEEN, *_TRUE, *actions, *stds, *_BEFELL)


def export_csv(session: Session, folder: Path, *, names: Iterable[str] | None = None) -> int:
    """Write ``episodes.csv`` and ``steps.csv`` into ``folder``, which is made; returns the number of steps.

    Numbers have as many digits as it takes to read back the same bits. Each episode has one more row than steps: the
    last, without phase and action, is what was seen after them. Images and cloth nodes are left out.
    """
    chosen = tuple(session.names if names is None else names)
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    folder.mkdir(parents=True, exist_ok=True)
    targets = [folder / EPISODES_CSV, folder / STEPS_CSV]
    asides = [target.with_name(f".{target.name}{PART_SUFFIX}") for target in targets]
    count = 0
    with (
        atomic_path(targets[0], asides[0]),
        atomic_path(targets[1], asides[1]),
        asides[0].open("x", newline="", encoding="utf-8") as about,
        asides[1].open("x", newline="", encoding="utf-8") as steps,
    ):
        about_rows, step_rows = csv.writer(about), csv.writer(steps)
        about_rows.writerow(EPISODE_COLUMNS)
        step_rows.writerow(step_columns(session.robot))
        for name in chosen:
            episode = session.episode(name, images=False)
            about_rows.writerow(_episode_row(name, episode))
            step_rows.writerows(_step_rows(name, episode))
            count += len(episode.steps)
    return count


def _episode_row(name: str, episode: Episode) -> list[object]:
    contact, end = episode.contact(), episode.final_ground_truth
    return [
        name,
        episode.robot.name,
        episode.cloth,
        episode.seed,
        episode.source,
        episode.outcome,
        episode.stopped_by,
        episode.disturbance,
        len(episode.steps),
        float(episode.step_s),
        float(contact[0]),
        float(contact[-1]),
        math.nan if end is None else float(end.contact_portion_true),
        math.nan if end is None else float(end.flat_area),
    ]


def _step_rows(name: str, episode: Episode) -> Iterator[list[object]]:
    size = episode.robot.size
    ground_truths = episode.ground_truths()
    for step_index, seen in enumerate(episode.observations()):
        true = [float(ground_truths[step_index].contact_portion_true), float(ground_truths[step_index].flat_area)]
        phase: str = ""
        done: list[object] = [""] * (2 * size + len(_BEFELL))
        if step_index < len(episode.steps):
            step = episode.steps[step_index]
            phase = step.phase
            done = [*step.action.tolist(), *_plain(step.action_std, size), *_befell(step)]
        yield [name, step_index, phase, *_seen(seen), *true, *done]


def _seen(seen: Observation) -> list[float]:
    return [
        float(seen.time_s),
        *seen.corner_positions.ravel().tolist(),
        *seen.holder_position.tolist(),
        *seen.word.tolist(),
        float(seen.word_strength),
        float(seen.contact_portion),
    ]


def _befell(step: Step) -> list[object]:
    pull = [""] * 4 if step.drag is None else [step.drag.node, *step.drag.target_m.tolist()]
    return [*step.force_n.tolist(), *pull, int(step.intervention)]


def _plain(std: FloatArray | None, size: int) -> list[object]:
    return [""] * size if std is None else std.tolist()
