"""What is run, as values: how much, which models, and the trials in which they meet the same starts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.policy.registry import TRAINABLE_POLICIES
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS
from layflat.sim.robots.registry import ROBOTS

CONTACT, DIRECTION = "gp-contact", "gp-direction"
RULE = "drag-rule"
RULED = f"{BASELINE}+{RULE}"
COMPARATORS = ("gp-finish", "nearest", "gmr", "dmp")
TOWEL, NAPKIN = "towel", "napkin"
"""The thesis's cloth 1 and cloth 2."""
DISTURBANCE, FOLD, TUG = "thesis", "fold-corner", "tug"
"""The stick of Table 4-2, the fold of Figure 5-2, and a hand that draws the free half to a side."""
FIRST_SEED = 3000
"""Of the starts; no seed above 2000 was looked at while anything was tuned."""
DEMONSTRATION_SEED = 1000


@dataclass(frozen=True, kw_only=True)
class ScaleConfig:
    """How much is run."""

    name: str
    seeds: int
    """Starts of each experiment of the thesis."""
    sweep_seeds: int
    """Starts of each point of a sweep: other numbers of demonstrations, other cloths, other learners."""
    demonstrations: int
    """What every model learns from unless the number is what is asked about."""
    counts: tuple[int, ...]
    """Numbers of demonstrations of the sweep; ``demonstrations`` is among them."""
    repeats: int
    """Disturbances of an episode in the experiments of Table 4-2."""

    def with_seeds(self, seeds: int) -> ScaleConfig:
        """With that many starts of each experiment, and of a sweep no more."""
        return replace(self, seeds=seeds, sweep_seeds=min(self.sweep_seeds, seeds))


FULL = ScaleConfig(
    name="full", seeds=20, sweep_seeds=8, demonstrations=10, counts=(1, 2, 3, 5, 7, 10, 15, 20), repeats=2
)
QUICK = ScaleConfig(name="quick", seeds=2, sweep_seeds=1, demonstrations=8, counts=(2, 8), repeats=2)


@dataclass(frozen=True, kw_only=True)
class ModelSpec:
    """A model: what learns, from how many demonstrations of which cloth."""

    policy: str
    robot: str
    cloth: str
    demonstrations: int

    @property
    def name(self) -> str:
        """Of the model's file."""
        return f"{self.policy}-{self.robot}-{self.cloth}-{self.demonstrations}"


@dataclass(frozen=True, kw_only=True)
class TrialPolicy:
    """Who takes part in a trial: a model, with or without a rule that repairs, or a controller of wrinkle removal."""

    name: str
    taught: ModelSpec | None = None
    made: str | None = None
    controller: str | None = None


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One batch: every player from the same starts, undisturbed and, from the same placing, disturbed."""

    name: str
    robot: str
    players: tuple[TrialPolicy, ...]
    cloth: str = TOWEL
    seeds: int
    start: str = "hanging"
    repeats: int = 0
    """How often DISTURBANCE comes, each time after the policy has stopped; 0: not at all."""
    others: tuple[str, ...] = ()
    """Disturbances that come once, each in an episode of its own."""

    @property
    def disturbances(self) -> tuple[tuple[str, int], ...]:
        """Name and repeats of the one disturbance of each disturbed episode."""
        return (*(((DISTURBANCE, self.repeats),) if self.repeats else ()), *((name, 1) for name in self.others))

    @property
    def episodes(self) -> int:
        return len(self.players) * self.seeds * (1 + len(self.disturbances))

    @property
    def taught(self) -> tuple[ModelSpec, ...]:
        return tuple(player.taught for player in self.players if player.taught is not None)


def learner(
    policy: str, robot: str, size: ScaleConfig, *, cloth: str = TOWEL, count: int = 0, name: str = ""
) -> TrialPolicy:
    """A model that plays under its policy's name, or another."""
    taught = ModelSpec(policy=policy, robot=robot, cloth=cloth, demonstrations=count or size.demonstrations)
    return TrialPolicy(name=name or policy, taught=taught)


def both(robot: str, size: ScaleConfig, cloth: str = TOWEL) -> tuple[TrialPolicy, ...]:
    """The thesis's baseline and its proposed method, taught on a cloth."""
    return learner(BASELINE, robot, size, cloth=cloth), learner(PROPOSED, robot, size, cloth=cloth)


def counted(count: int) -> str:
    """Name of the proposed method that learned from ``count`` demonstrations, in the sweep."""
    return f"{PROPOSED}@{count}"


def flattening(size: ScaleConfig) -> Iterator[Trial]:
    players = tuple(TrialPolicy(name=name, controller=name) for name in CONTROLLERS)
    yield Trial(name="flattening", robot="pickers", players=players, seeds=size.seeds, start="crumpled")


def placing(size: ScaleConfig) -> Iterator[Trial]:
    for robot in ROBOTS:
        yield Trial(
            name=f"placing-{robot}", robot=robot, players=both(robot, size), seeds=size.seeds, repeats=size.repeats,
            others=(FOLD, TUG),
        )  # fmt: skip


def second_cloth(size: ScaleConfig) -> Iterator[Trial]:
    for robot in ROBOTS:
        players = both(robot, size, NAPKIN)
        yield Trial(
            name=f"napkin-{robot}", robot=robot, players=players, cloth=NAPKIN, seeds=size.seeds, repeats=size.repeats
        )


def inputs(size: ScaleConfig) -> Iterator[Trial]:
    for robot in ROBOTS:
        ruled = TrialPolicy(name=RULED, taught=learner(BASELINE, robot, size).taught, made=RULE)
        players = (learner(CONTACT, robot, size), learner(DIRECTION, robot, size), ruled)
        yield Trial(
            name=f"inputs-{robot}", robot=robot, players=players, seeds=size.seeds, repeats=size.repeats, others=(TUG,)
        )


def bad_contact(size: ScaleConfig) -> Iterator[Trial]:
    for robot in ROBOTS:
        yield Trial(
            name=f"bad-contact-{robot}", robot=robot, players=both(robot, size), seeds=size.seeds, start="swinging"
        )


def number_of_demonstrations(size: ScaleConfig) -> Iterator[Trial]:
    for robot in ROBOTS:
        others = [count for count in size.counts if count != size.demonstrations]
        players = tuple(learner(PROPOSED, robot, size, count=count, name=counted(count)) for count in others)
        yield Trial(name=f"counts-{robot}", robot=robot, players=players, seeds=size.sweep_seeds, repeats=1)


def other_cloth(size: ScaleConfig) -> Iterator[Trial]:
    for robot in ROBOTS:
        for cloth, other in ((TOWEL, NAPKIN), (NAPKIN, TOWEL)):
            yield Trial(
                name=f"transfer-{robot}-{cloth}", robot=robot, players=both(robot, size, other), cloth=cloth,
                seeds=size.sweep_seeds, repeats=1,
            )  # fmt: skip


def comparators(size: ScaleConfig) -> Iterator[Trial]:
    for robot in ROBOTS:
        players = tuple(learner(policy, robot, size) for policy in COMPARATORS if policy in TRAINABLE_POLICIES)
        if players:
            yield Trial(name=f"comparators-{robot}", robot=robot, players=players, seeds=size.sweep_seeds, repeats=1)
