"""WorkItem: episodes that start with the same placement, for one process."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from layflat.app.support.errors import UsageError
from layflat.data.session.journal import JournalHandle
from layflat.data.session.reader import open_session
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import Episode
from layflat.policy.schedule import ScheduledDisturbance
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig

LIMIT_S = 900.0
"""Wall time after which an episode counts as hung; a slow machine needs about 30 s."""
SEPARATOR = "--"
"""Separator of the parts of a run's name; no part contains it."""
_CASE = re.compile(r"[a-z0-9]+([-_][a-z0-9]+)*(/[a-z0-9]+([-_][a-z0-9]+)*)?")


@dataclass(frozen=True, kw_only=True)
class DisturbanceCase:
    """The disturbances of one episode."""

    name: str
    """As in the column ``disturbance``: ``suite/case`` where a suite has several cases."""
    schedule: tuple[ScheduledDisturbance, ...] = ()

    def __post_init__(self) -> None:
        if not _CASE.fullmatch(self.name):
            raise UsageError(f"disturbance name {self.name!r} must be small letters, digits and -, as in folds/corner")

    @property
    def is_post_stop(self) -> bool:
        """Whether nothing happens before the policy has stopped, so that the placement is the undisturbed one."""
        return all(item.trigger.kind == "stopped" for item in self.schedule)


NO_DISTURBANCE = DisturbanceCase(name="none")


@dataclass(frozen=True, kw_only=True)
class WorkItem:
    """Episodes of one policy from one start: one placement, and a fork of its process for each case."""

    policy: PolicySpec
    config: SimConfig
    seed: int
    cases: tuple[DisturbanceCase, ...] = (NO_DISTURBANCE,)
    limit_s: float = LIMIT_S
    """Wall time of the placement, and again of each case."""
    attempt: int = 1
    keep_images: bool = False
    handle: JournalHandle | None = None
    """Journal of the session in which the only case is recorded; None: each case has a file of its own."""

    def __post_init__(self) -> None:
        if self.handle is not None and len(self.cases) != 1:
            raise ValueError("an item that is recorded has one case")

    def run_id(self, case: DisturbanceCase) -> str:
        """Return the name of the episode, unique in an evaluation, and of its file."""
        config = self.config
        parts = (config.robot, config.cloth, self.policy.label, f"s{self.seed:04d}", case.name.replace("/", "."))
        return SEPARATOR.join(parts)

    @cached_property
    def run_ids(self) -> tuple[str, ...]:
        """Names of the episodes, in the order of the cases."""
        return tuple(self.run_id(case) for case in self.cases)

    @property
    def is_taught(self) -> bool:
        """Whether the policy's model learned from a demonstration of this very start."""
        model, config = self.policy.model, self.config
        if model is None or not {(str(config.start), self.seed), ("", self.seed)} & set(model.taught):
            return False
        return (model.layout.robot.name, model.task, model.cloth) == (config.robot, config.task, config.cloth)

    def subset(self, wanted: Container[str], *, attempt: int | None = None) -> WorkItem:
        """Return the item with only those cases whose run is wanted."""
        cases = tuple(case for case, run in zip(self.cases, self.run_ids, strict=True) if run in wanted)
        return replace(self, cases=cases, attempt=attempt or self.attempt)


@dataclass(frozen=True)
class WorkResult:
    """Result of a work item; episodes that are not lost are durable."""

    item: WorkItem
    lost: Mapping[str, str]
    """Reason by run."""
    rows: Mapping[str, dict[str, Any]]
    """Metrics by run, as far as the worker could still send them; they also follow from the file."""
    saved: SavedEpisode | None = None
    """Report of the recorded episode, for an item with a handle."""
    unwritable: str | None = None
    """Why the folder takes no more files."""


def run_file(folder: Path, run: str) -> Path:
    """Return the path of an episode's file."""
    return folder / f"{run}.h5"


def read_run(folder: Path, run: str, *, images: bool = False) -> Episode:
    """Return the episode of a run from its file."""
    with open_session(run_file(folder, run)) as session:
        return next(session.episodes(images=images))
