"""EvaluationPlan: policies x robots x cloths x seeds x disturbances, paired.

Every policy of a robot meets the same starts and the same disturbances, and each disturbed episode has its undisturbed
pair: both come out of one placement (`layflat.app.workers.episode_worker`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from layflat.app.support.errors import UsageError
from layflat.app.support.validators import one_of
from layflat.app.workers.sim_options import sim_config
from layflat.app.workers.work_item import LIMIT_S, NO_DISTURBANCE, DisturbanceCase, WorkItem
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy.spec import PolicySpec
from layflat.sim.conditions.variation import NO_VARIATION, Variation
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.sim.tasks import DEFAULT_TASK


@dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """The episodes of an evaluation: a plan gives the same rows with any number of workers and on any engine."""

    policies: tuple[PolicySpec, ...]
    robots: tuple[str, ...]
    """A model only takes part with the robot that it was trained for."""
    cloths: tuple[str, ...]
    seeds: tuple[int, ...]
    cases: tuple[DisturbanceCase, ...] = ()
    """Besides the undisturbed one, which is always there."""
    task: str = DEFAULT_TASK
    start: str | None = None
    """None: the default of the task."""
    descriptor: str = DEFAULT_DESCRIPTOR
    """Descriptor of WORD for policies without a model; a model has its own."""
    settings: tuple[str, ...] = ()
    """Conditions of all episodes, KEY=VALUE."""
    variation: Variation = NO_VARIATION
    """Conditions that each seed draws."""
    limit_s: float = LIMIT_S
    """Wall time of a placement, and again of each case; what takes longer is lost."""

    def __post_init__(self) -> None:
        for kind, values in (
            ("robot", self.robots),
            ("policy", [(robot, policy.label) for robot, policy in self.entries]),
            ("cloth", self.cloths),
            ("seed", self.seeds),
            ("disturbance", [case.name for case in self.all_cases]),
        ):
            _check_unique(kind, values)
        for policy in self.policies:
            policy.check_task(self.task)
        starts = {self.config(robot, cloth, policy).start for robot, policy in self.entries for cloth in self.cloths}
        object.__setattr__(self, "start", starts.pop())
        if not self.limit_s > 0:
            raise UsageError(f"--limit-s is {self.limit_s}; it must be above 0")

    @property
    def entries(self) -> tuple[tuple[str, PolicySpec], ...]:
        """Every robot with each policy that takes part with it."""
        return tuple(
            (robot, policy)
            for robot in self.robots
            for policy in self.policies
            if policy.robot is None or robot_spec(robot).same_axes(policy.robot)
        )

    @property
    def all_cases(self) -> tuple[DisturbanceCase, ...]:
        """The undisturbed case and the others."""
        return (NO_DISTURBANCE, *self.cases)

    @property
    def n_episodes(self) -> int:
        """Number of episodes."""
        return len(self.entries) * len(self.cloths) * len(self.seeds) * len(self.all_cases)

    @property
    def taught(self) -> tuple[dict[str, Any], ...]:
        """Policies that are tried on starts that they were taught, with the seeds of these."""
        found: dict[tuple[str, str, str], list[int]] = {}
        for item in self.items():
            if item.is_taught:
                found.setdefault((item.policy.label, item.config.robot, item.config.cloth), []).append(item.seed)
        names = ("policy", "robot", "cloth")
        return tuple({**dict(zip(names, key, strict=True)), "seeds": seeds} for key, seeds in found.items())

    def config(self, robot: str, cloth: str, policy: PolicySpec) -> SimConfig:
        """Return the simulation in which a policy acts; UsageError where the task or the start is impossible."""
        descriptor = self.descriptor if policy.model is None else policy.descriptor
        return sim_config(
            self.settings, robot=robot, task=self.task, cloth=cloth, start=self.start, descriptor=descriptor
        )

    def items(self) -> Iterator[WorkItem]:
        """Yield the work items by robot and cloth, then start by start, so that a part of them is paired too."""
        for robot in self.robots:
            for cloth in self.cloths:
                for seed in self.seeds:
                    for own, policy in self.entries:
                        if own == robot:
                            yield WorkItem(
                                policy=policy,
                                config=self.config(robot, cloth, policy).under(self.variation.sample(seed)),
                                seed=seed,
                                cases=self.all_cases,
                                limit_s=self.limit_s,
                            )


def plan_policies(texts: Sequence[str], robots: Sequence[str]) -> tuple[tuple[PolicySpec, ...], tuple[str, ...]]:
    """Read the POLICY texts of a command line; return the policies and the robots they are tried with.

    Policies whose labels are the same are labelled with the names of their files as well. Without ``robots`` they are
    those of the models. UsageError where no robot is left, or a model is for another one.
    """
    policies = [PolicySpec.parse(text) for text in texts]
    trained = dict.fromkeys(policy.robot.name for policy in policies if policy.robot is not None)
    wanted = tuple(robot for robot in ROBOTS if robot in [one_of("robot", name, ROBOTS) for name in robots or trained])
    if not wanted:
        raise UsageError(f"a policy without a model suits any robot; give --robot {' or --robot '.join(ROBOTS)}")
    for policy in policies:
        own = policy.robot
        if own is not None and not any(robot_spec(robot).same_axes(own) for robot in wanted):
            raise UsageError(
                f"{policy.stem} was trained for robot {policy.robot}, not {', '.join(wanted)}; leave it out"
            )
    return tuple(_with_distinct_labels(policies, texts)), wanted


def _with_distinct_labels(policies: Sequence[PolicySpec], texts: Sequence[str]) -> Iterator[PolicySpec]:
    same = [(policy.robot, policy.label) for policy in policies]
    for policy, text in zip(policies, texts, strict=True):
        named = text.startswith(f"{policy.label}=")
        yield policy if named or same.count((policy.robot, policy.label)) == 1 else policy.with_file_name()


def _check_unique(kind: str, values: Sequence[object]) -> None:
    if not values:
        raise UsageError(f"there is no {kind}; at least one is needed")
    for position, value in enumerate(values):
        if value in values[:position]:
            words = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            raise UsageError(f"{kind} {words} is there twice; each must have a name of its own")
