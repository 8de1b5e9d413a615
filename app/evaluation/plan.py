"""What a batch runs: policies x cloths x seeds x disturbances, paired.

Every policy of a task meets the same starts and the same disturbances, and each disturbed episode has its undisturbed
twin: both come out of one placing (``group.py``).
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from layflat.app.support.errors import WrongCall
from layflat.app.support.validators import known_name
from layflat.app.workers.make_policy import SCRIPTED
from layflat.app.workers.schedule import ScheduledDisturbance
from layflat.data.types import TASKS, Task
from layflat.perception.descriptors.registry import DEFAULT
from layflat.policy.registry import DECORATORS, MADE
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS
from layflat.policy.trained_model import Learned
from layflat.sim.cloth.cloth import CLOTHS
from layflat.sim.cloth.starts import STARTS, Start
from layflat.sim.config import BenchSettings
from layflat.sim.physics.bullet.world import SimError

LIMIT_S = 900.0
"""Wall time after which an episode counts as hung; a slow machine needs about 30 s."""
SEPARATOR = "--"
"""Between the parts of a run's name; no part holds it."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+@]*(-[A-Za-z0-9._+@]+)*")
_CASE = re.compile(r"[a-z0-9]+([-_][a-z0-9]+)*(/[a-z0-9]+([-_][a-z0-9]+)*)?")


@dataclass(frozen=True, kw_only=True)
class Entrant:
    """Who takes part, in one task: a trained model, a policy made by name, or a controller of wrinkle removal."""

    name: str
    """As in the column ``policy``."""
    task: Task
    model: Learned | None = None
    made: str | None = None
    """A name of layflat.policy.registry.MADE, or "scripted"; with a model: who takes over after a disturbance."""
    controller: str | None = None
    """A name of layflat.policy.scripted.wrinkle_removal.CONTROLLERS; it begins from a crumpled cloth."""
    decorators: tuple[str, ...] = ()
    """Of layflat.policy.registry.DECORATORS, what is around the policy."""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise WrongCall(f"policy name {self.name!r} cannot be part of a file's name; use letters, digits and .+@-")
        known_name("task", self.task, TASKS)
        if self.made is not None:
            known_name("policy", self.made, (*MADE, *(() if self.model else (SCRIPTED,))))
        if self.controller is not None:
            known_name("controller", self.controller, CONTROLLERS)
        for name in self.decorators:
            known_name("decorator", name, DECORATORS)
        if self.model is not None and self.model.layout.task != self.task:
            raise WrongCall(f"{self.name} was taught the {self.model.layout.task} task, not {self.task}")
        if (self.controller is not None) == (self.model is not None or self.made is not None):
            raise WrongCall(f"{self.name} must be a model, a policy by name, or a controller")

    @property
    def descriptor(self) -> str:
        return DEFAULT if self.model is None else self.model.descriptor


@dataclass(frozen=True, kw_only=True)
class Case:
    """What happens to the cloth in an episode."""

    name: str
    """As in the column ``disturbance``: of a suite with several cases ``suite/case``."""
    schedule: tuple[ScheduledDisturbance, ...] = ()

    def __post_init__(self) -> None:
        if not _CASE.fullmatch(self.name):
            raise WrongCall(f"disturbance name {self.name!r} must be small letters, digits and -, as in folds/corner")

    @property
    def after_the_stop(self) -> bool:
        """Nothing happens before the policy has stopped, so that the placing is that of the undisturbed twin."""
        return all(item.when.moment == "stopped" for item in self.schedule)


UNDISTURBED = Case(name="none")


@dataclass(frozen=True, kw_only=True)
class Group:
    """Episodes that begin with the same placing: one process, forked for each case."""

    entrant: Entrant
    cloth: str
    seed: int
    start: Start
    cases: tuple[Case, ...]
    limit_s: float
    attempt: int = 1

    def run_id(self, case: Case) -> str:
        """Unique in a batch, and the name of the episode's file."""
        parts = (self.entrant.task, self.cloth, self.entrant.name, f"s{self.seed:04d}", case.name.replace("/", "."))
        return SEPARATOR.join(parts)

    @cached_property
    def run_ids(self) -> tuple[str, ...]:
        return tuple(self.run_id(case) for case in self.cases)

    def only(self, wanted: Container[str], *, attempt: int | None = None) -> Group:
        """The group with those cases whose run is wanted."""
        cases = tuple(case for case, run in zip(self.cases, self.run_ids, strict=True) if run in wanted)
        return replace(self, cases=cases, attempt=attempt or self.attempt)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A batch, settled: the same plan gives the same rows, however many workers share it, and on any engine."""

    entrants: tuple[Entrant, ...]
    cloths: tuple[str, ...]
    seeds: tuple[int, ...]
    cases: tuple[Case, ...] = ()
    """Besides the undisturbed one, which is always there."""
    start: Start = "hanging"
    limit_s: float = LIMIT_S
    """Wall time for the placing, and again for each case; what takes longer is lost."""

    def __post_init__(self) -> None:
        for kind, values in (
            ("policy", [(entrant.task, entrant.name) for entrant in self.entrants]),
            ("cloth", self.cloths),
            ("seed", self.seeds),
            ("disturbance", [case.name for case in self.all_cases]),
        ):
            _each_once(kind, values)
        for cloth in self.cloths:
            known_name("cloth", cloth, CLOTHS)
        known_name("start", self.start, STARTS)
        for task in self.tasks:
            _possible(task, self.start)
        if not self.limit_s > 0:
            raise WrongCall(f"--limit-s is {self.limit_s}; it must be above 0")

    @property
    def tasks(self) -> tuple[Task, ...]:
        return tuple(dict.fromkeys(entrant.task for entrant in self.entrants))

    @property
    def all_cases(self) -> tuple[Case, ...]:
        return (UNDISTURBED, *self.cases)

    @property
    def episodes(self) -> int:
        return len(self.entrants) * len(self.cloths) * len(self.seeds) * len(self.all_cases)

    def groups(self) -> Iterator[Group]:
        """In the order of the finished rows: by task and cloth, then start by start, so that a part is paired, too."""
        for task in self.tasks:
            for cloth in self.cloths:
                for seed in self.seeds:
                    for entrant in self.entrants:
                        if entrant.task == task:
                            yield Group(
                                entrant=entrant,
                                cloth=cloth,
                                seed=seed,
                                start=self.start,
                                cases=self.all_cases,
                                limit_s=self.limit_s,
                            )


def _possible(task: Task, start: Start) -> None:
    try:
        BenchSettings(task=task, start=start)
    except SimError as error:
        raise WrongCall(str(error)) from None


def _each_once(kind: str, values: Sequence[object]) -> None:
    if not values:
        raise WrongCall(f"there is no {kind}; at least one is needed")
    for position, value in enumerate(values):
        if value in values[:position]:
            words = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            raise WrongCall(f"{kind} {words} is there twice; each must have a name of its own")
