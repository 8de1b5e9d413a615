"""When the disturbances of an episode start, how often, and which they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

from layflat.policy.base import PolicyError

TriggerKind: TypeAlias = Literal["stopped", "step", "contact"]


@dataclass(frozen=True, kw_only=True)
class Trigger:
    """The condition that starts a disturbance."""

    kind: TriggerKind = "stopped"
    """After the policy has stopped, at a step of placing, or when the camera first sees a contact portion."""
    value: float = 0.0
    """The step, or the contact portion."""

    def __post_init__(self) -> None:
        if self.kind == "step" and not (self.value >= 0 and float(self.value).is_integer()):
            raise PolicyError(f"disturbance step must be an integer >= 0, got {self.value}")
        if self.kind == "contact" and not 0 <= self.value <= 1:
            raise PolicyError(f"disturbance contact must be within 0..1, got {self.value}")

    def is_due(self, step_index: int, contact: float) -> bool:
        """Whether the disturbance starts before this step of placing, at the contact portion that the camera sees."""
        if self.kind == "stopped":
            return False
        return (step_index if self.kind == "step" else contact) >= self.value


@dataclass(frozen=True, kw_only=True)
class ScheduledDisturbance:
    """A disturbance of an episode. All ``repeats`` but the first start after the policy has stopped again."""

    disturbance: Any
    """Argument of `Environment.disturb`: a name, or an object with a ``name``."""
    trigger: Trigger = Trigger()
    repeats: int = 1

    def __post_init__(self) -> None:
        if self.repeats < 1:
            raise PolicyError(f"disturbance {self.name} must be repeated at least once, got {self.repeats}")

    @property
    def name(self) -> str:
        """Name of the disturbance, for tables and files."""
        return str(getattr(self.disturbance, "name", self.disturbance))


class DueDisturbance(NamedTuple):
    """A disturbance that starts now."""

    disturbance: Any
    repeat: int
    """Position among all disturbances of the schedule, from which it is drawn: the same for every policy."""


class DisturbanceScheduler:
    """The part of a schedule that has not started yet."""

    def __init__(self, schedule: Sequence[ScheduledDisturbance] = ()) -> None:
        self._waiting: list[tuple[Trigger, DueDisturbance]] = []
        self._later: list[DueDisturbance] = []
        for item in schedule:
            for count in range(item.repeats):
                due = DueDisturbance(item.disturbance, len(self._waiting) + len(self._later))
                if count == 0 and item.trigger.kind != "stopped":
                    self._waiting.append((item.trigger, due))
                else:
                    self._later.append(due)

    def pop_due(self, step_index: int, contact: float) -> DueDisturbance | None:
        """Remove and return a disturbance that starts before this step of placing, or None."""
        for place, (trigger, due) in enumerate(self._waiting):
            if trigger.is_due(step_index, contact):
                del self._waiting[place]
                return due
        return None

    def remaining_after_stop(self) -> Iterator[DueDisturbance]:
        """Yield the disturbances that start after the policy has stopped, in the schedule's order.

        One whose step was not reached starts now; one whose contact portion was never reached does not start.
        """
        missed = [due for trigger, due in self._waiting if trigger.kind == "step"]
        self._waiting.clear()
        while left := sorted([*missed, *self._later], key=lambda due: due.repeat):
            missed, self._later = [], left[1:]
            yield left[0]
