"""When a disturbance comes, how often, and which."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from layflat.app.support.errors import UsageError
from layflat.sim.disturbances.presets import DisturbanceSpec

TriggerKind: TypeAlias = Literal["stopped", "step", "contact"]


@dataclass(frozen=True, kw_only=True)
class Trigger:
    """The moment at which a disturbance begins."""

    moment: TriggerKind = "stopped"
    """After the policy has stopped, at a step of placing, or when the camera first sees a contact portion."""
    value: float = 0.0
    """The step, or the contact portion."""

    def __post_init__(self) -> None:
        if self.moment == "step" and not (self.value >= 0 and float(self.value).is_integer()):
            raise UsageError(f"a disturbance is to begin at step {self.value}; it must be a whole number from 0 on")
        if self.moment == "contact" and not 0 <= self.value <= 1:
            raise UsageError(f"a disturbance is to begin at contact {self.value}; it must be a portion from 0 to 1")

    def reached(self, step_index: int, contact: float) -> bool:
        """Whether it comes before this step of placing, with the contact portion that the camera sees now."""
        if self.moment == "stopped":
            return False
        return (step_index if self.moment == "step" else contact) >= self.value


@dataclass(frozen=True, kw_only=True)
class ScheduledDisturbance:
    """One disturbance of an episode. All ``repeats`` but the first come after the policy has stopped again."""

    spec: DisturbanceSpec
    when: Trigger = Trigger()
    repeats: int = 1

    def __post_init__(self) -> None:
        if self.repeats < 1:
            raise UsageError(f"disturbance {self.spec.name} is to come {self.repeats} times; it must be at least once")


@dataclass(frozen=True, kw_only=True)
class DueDisturbance:
    """One disturbance whose moment has come."""

    spec: DisturbanceSpec
    repeat: int
    """Its chance: the place among all of the schedule, whatever came first, so that each policy meets the same."""


class DisturbanceScheduler:
    """What of a schedule is still to come."""

    def __init__(self, schedule: Sequence[ScheduledDisturbance] = ()) -> None:
        self._waiting: list[tuple[Trigger, DueDisturbance]] = []
        self._later: list[DueDisturbance] = []
        for item in schedule:
            for count in range(item.repeats):
                due = DueDisturbance(spec=item.spec, repeat=len(self._waiting) + len(self._later))
                if count == 0 and item.when.moment != "stopped":
                    self._waiting.append((item.when, due))
                else:
                    self._later.append(due)

    def now(self, step_index: int, contact: float) -> DueDisturbance | None:
        """What is to begin before this step of placing; it is not told twice."""
        for place, (when, due) in enumerate(self._waiting):
            if when.reached(step_index, contact):
                del self._waiting[place]
                return due
        return None

    def after_stop(self) -> Iterator[DueDisturbance]:
        """What is left when the policy has stopped, in the schedule's order.

        A step that was not reached comes now: the cloth lies as it would then. A contact portion that was never
        reached does not come.
        """
        missed = [due for when, due in self._waiting if when.moment == "step"]
        self._waiting.clear()
        while left := sorted([*missed, *self._later], key=lambda due: due.repeat):
            missed, self._later = [], left[1:]
            yield left[0]
