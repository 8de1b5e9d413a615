"""What a batch runs: policies x cloths x seeds x disturbances, paired.

Every policy of a robot meets the same starts and the same disturbances, and each disturbed episode has its undisturbed
twin: both come out of one placing (``group.py``).
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from layflat.app.support.errors import UsageError
from layflat.app.support.validators import one_of
from layflat.app.workers.make_policy import SCRIPTED
from layflat.app.workers.schedule import ScheduledDisturbance
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy.registry import BUILTIN_POLICIES, WRAPPERS
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS
from layflat.policy.trained_model import TrainedModel
from layflat.sim.cloth.cloth import CLOTHS
from layflat.sim.cloth.starts import STARTS, Start
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import ROBOTS

LIMIT_S = 900.0
"""Wall time after which an episode counts as hung; a slow machine needs about 30 s."""
SEPARATOR = "--"
"""Between the parts of a run's name; no part holds it."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+@]*(-[A-Za-z0-9._+@]+)*")
_CASE = re.compile(r"[a-z0-9]+([-_][a-z0-9]+)*(/[a-z0-9]+([-_][a-z0-9]+)*)?")


@dataclass(frozen=True, kw_only=True)
class PolicySpec:
    """Who takes part, in one robot: a trained model, a policy made by name, or a controller of wrinkle removal."""

    name: str
    """As in the column ``policy``."""
    robot: str
    model: TrainedModel | None = None
    made: str | None = None
    """A name of layflat.policy.registry.BUILTIN_POLICIES, or "scripted"; with a model: who takes over after a
    disturbance."""
    controller: str | None = None
    """A name of layflat.policy.scripted.wrinkle_removal.CONTROLLERS; it begins from a crumpled cloth."""
    decorators: tuple[str, ...] = ()
    """Of layflat.policy.registry.WRAPPERS, what is around the policy."""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise UsageError(f"policy name {self.name!r} cannot be part of a file's name; use letters, digits and .+@-")
        one_of("robot", self.robot, ROBOTS)
        if self.made is not None:
            one_of("policy", self.made, (*BUILTIN_POLICIES, *(() if self.model else (SCRIPTED,))))
        if self.controller is not None:
            one_of("controller", self.controller, CONTROLLERS)
        for name in self.decorators:
            one_of("decorator", name, WRAPPERS)
        if self.model is not None and self.model.layout.robot.name != self.robot:
            raise UsageError(f"{self.name} was taught the {self.model.layout.robot} robot, not {self.robot}")
        if (self.controller is not None) == (self.model is not None or self.made is not None):
            raise UsageError(f"{self.name} must be a model, a policy by name, or a controller")

    @property
    def descriptor(self) -> str:
        return DEFAULT_DESCRIPTOR if self.model is None else self.model.descriptor


@dataclass(frozen=True, kw_only=True)
class DisturbanceCase:
    """What happens to the cloth in an episode."""

    name: str
    """As in the column ``disturbance``: of a suite with several cases ``suite/case``."""
    schedule: tuple[ScheduledDisturbance, ...] = ()

    def __post_init__(self) -> None:
        if not _CASE.fullmatch(self.name):
            raise UsageError(f"disturbance name {self.name!r} must be small letters, digits and -, as in folds/corner")

    @property
    def after_the_stop(self) -> bool:
        """Nothing happens before the policy has stopped, so that the placing is that of the undisturbed twin."""
        return all(item.when.moment == "stopped" for item in self.schedule)


NO_DISTURBANCE = DisturbanceCase(name="none")


@dataclass(frozen=True, kw_only=True)
class WorkItem:
    """Episodes that begin with the same placing: one process, forked for each case."""

    entrant: PolicySpec
    cloth: str
    seed: int
    start: Start
    cases: tuple[DisturbanceCase, ...]
    limit_s: float
    attempt: int = 1

    def run_id(self, case: DisturbanceCase) -> str:
        """Unique in a batch, and the name of the episode's file."""
        parts = (self.entrant.robot, self.cloth, self.entrant.name, f"s{self.seed:04d}", case.name.replace("/", "."))
        return SEPARATOR.join(parts)

    @cached_property
    def run_ids(self) -> tuple[str, ...]:
        return tuple(self.run_id(case) for case in self.cases)

    def only(self, wanted: Container[str], *, attempt: int | None = None) -> WorkItem:
        """The group with those cases whose run is wanted."""
        cases = tuple(case for case, run in zip(self.cases, self.run_ids, strict=True) if run in wanted)
        return replace(self, cases=cases, attempt=attempt or self.attempt)


@dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """A batch, settled: the same plan gives the same rows, however many workers share it, and on any engine."""

    entrants: tuple[PolicySpec, ...]
    cloths: tuple[str, ...]
    seeds: tuple[int, ...]
    cases: tuple[DisturbanceCase, ...] = ()
    """Besides the undisturbed one, which is always there."""
    start: Start = "hanging"
    limit_s: float = LIMIT_S
    """Wall time for the placing, and again for each case; what takes longer is lost."""

    def __post_init__(self) -> None:
        for kind, values in (
            ("policy", [(entrant.robot, entrant.name) for entrant in self.entrants]),
            ("cloth", self.cloths),
            ("seed", self.seeds),
            ("disturbance", [case.name for case in self.all_cases]),
        ):
            _each_once(kind, values)
        for cloth in self.cloths:
            one_of("cloth", cloth, CLOTHS)
        one_of("start", self.start, STARTS)
        for robot in self.robots:
            _possible(robot, self.start)
        if not self.limit_s > 0:
            raise UsageError(f"--limit-s is {self.limit_s}; it must be above 0")

    @property
    def robots(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(entrant.robot for entrant in self.entrants))

    @property
    def all_cases(self) -> tuple[DisturbanceCase, ...]:
        return (NO_DISTURBANCE, *self.cases)

    @property
    def episodes(self) -> int:
        return len(self.entrants) * len(self.cloths) * len(self.seeds) * len(self.all_cases)

    def groups(self) -> Iterator[WorkItem]:
        """In the order of the finished rows: by robot and cloth, then start by start, so that a part is paired, too."""
        for robot in self.robots:
            for cloth in self.cloths:
                for seed in self.seeds:
                    for entrant in self.entrants:
                        if entrant.robot == robot:
                            yield WorkItem(
                                entrant=entrant,
                                cloth=cloth,
                                seed=seed,
                                start=self.start,
                                cases=self.all_cases,
                                limit_s=self.limit_s,
                            )


def _possible(robot: str, start: Start) -> None:
    try:
        SimConfig(robot=robot, start=start)
    except SimError as error:
        raise UsageError(str(error)) from None


def _each_once(kind: str, values: Sequence[object]) -> None:
    if not values:
        raise UsageError(f"there is no {kind}; at least one is needed")
    for position, value in enumerate(values):
        if value in values[:position]:
            words = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            raise UsageError(f"{kind} {words} is there twice; each must have a name of its own")
