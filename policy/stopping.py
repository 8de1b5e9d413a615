"""When a policy has finished: small predicates, joined by any and all.

A rule is told of every step, once, and says on which one it would stop. ``reset`` makes it new: at the start of an
episode, and when a policy goes on after a disturbance.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Observation, StoppedBy
from layflat.policy.base import PolicyError


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Why to stop: one of the words that files know, and a clause for a person."""

    by: StoppedBy
    reason: str


@runtime_checkable
class StopRule(Protocol):
    """One reason to stop."""

    def reset(self) -> None:
        """Forget all steps so far."""

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        """Take note of one step (the action is (A,) m); a Stop while the condition holds, else None."""


class BelowThreshold:
    """The norm of the action stayed below ``threshold_m`` for ``steps`` steps in a row (thesis, chapter 4-2-3).

    The thesis stops at the first such step; a larger ``steps`` keeps a pause between two moves from ending the episode.
    """

    def __init__(self, *, threshold_m: float, n_steps: int = 1) -> None:
        self._threshold_m = _positive("threshold_m", threshold_m)
        self._n_steps = _at_least_one("steps", n_steps)
        self._count = 0

    def reset(self) -> None:
        self._count = 0

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        self._count = self._count + 1 if float(np.linalg.norm(action)) < self._threshold_m else 0
        if self._count < self._n_steps:
            return None
        return Stop(by="threshold", reason=f"output below {1000 * self._threshold_m:g} mm for {self._n_steps} steps")


class StepLimit:
    """``steps`` steps have passed since the last reset, this one included."""

    def __init__(self, n_steps: int) -> None:
        self._n_steps = _at_least_one("steps", n_steps)
        self._count = 0

    def reset(self) -> None:
        self._count = 0

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        self._count += 1
        if self._count < self._n_steps:
            return None
        return Stop(by="step_limit", reason=f"{self._n_steps} steps have passed")


class NoContactGain:
    """The best contact portion so far has not risen by ``gain`` for ``steps`` steps.

    Nothing counts before the contact portion has reached ``from_contact``: a cloth that still hangs in the air gains
    nothing, and must not be given up for it.
    """

    def __init__(self, *, n_steps: int, gain: float = 0.002, from_contact: float = 0.0) -> None:
        self._n_steps = _at_least_one("steps", n_steps)
        self._gain = _positive("gain", gain)
        self._from_contact = from_contact
        self._best: float | None = None
        self._count = 0

    def reset(self) -> None:
        self._best = None
        self._count = 0

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        contact = observation.contact_portion
        if self._best is None:
            if contact >= self._from_contact:
                self._best = contact
            return None
        if contact >= self._best + self._gain:
            self._best, self._count = contact, 0
            return None
        self._count += 1
        if self._count < self._n_steps:
            return None
        return Stop(by="converged", reason=f"no gain of contact for {self._n_steps} steps")


class Stuck:
    """The holder has stayed within ``within_m`` along each axis for ``steps`` steps: it pulls, and nothing yields."""

    def __init__(self, *, n_steps: int, within_m: float) -> None:
        self._n_steps = _at_least_one("steps", n_steps)
        self._within_m = _positive("within_m", within_m)
        self._places: deque[FloatArray] = deque(maxlen=self._n_steps)

    def reset(self) -> None:
        self._places.clear()

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        self._places.append(observation.holder_position)
        if len(self._places) < self._n_steps or np.ptp(np.array(self._places), axis=0).max() >= self._within_m:
            return None
        return Stop(
            by="converged", reason=f"holder has stayed within {1000 * self._within_m:g} mm for {self._n_steps} steps"
        )


class ContactReached:
    """The contact portion has been at least ``contact`` for ``steps`` steps in a row."""

    def __init__(self, contact: float, *, n_steps: int = 1) -> None:
        self._contact = _positive("contact", contact)
        self._n_steps = _at_least_one("steps", n_steps)
        self._count = 0

    def reset(self) -> None:
        self._count = 0

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        self._count = self._count + 1 if observation.contact_portion >= self._contact else 0
        if self._count < self._n_steps:
            return None
        return Stop(by="converged", reason=f"contact portion has reached {self._contact:g}")


class XLimit:
    """The holder is at or beyond ``x_m`` (world) to the front: the end of what the camera sees and the arm reaches.

    Files have no word of their own for it; it counts as a limit, ``step_limit``, and the reason says which one.
    """

    def __init__(self, x_m: float) -> None:
        self._x_m = x_m

    def reset(self) -> None:
        """Nothing to forget."""

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        if observation.holder_position[0] < self._x_m:
            return None
        return Stop(by="step_limit", reason=f"holder has reached the limit x = {self._x_m:g} m")


class AnyOf:
    """Stops when one of the rules does, for the first one's reason."""

    def __init__(self, *rules: StopRule) -> None:
        self._rules = rules

    def reset(self) -> None:
        for rule in self._rules:
            rule.reset()

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        # Every rule hears of every step, also those after the first that fires: they count.
        stops = [rule.update(observation, action) for rule in self._rules]
        return next((stop for stop in stops if stop is not None), None)


class AllOf:
    """Stops when all of the rules (at least one) do in the same step; files get the first one's word."""

    def __init__(self, first: StopRule, *others: StopRule) -> None:
        self._rules = (first, *others)

    def reset(self) -> None:
        for rule in self._rules:
            rule.reset()

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        stops = [rule.update(observation, action) for rule in self._rules]
        held = [stop for stop in stops if stop is not None]
        if len(held) < len(stops):
            return None
        return Stop(by=held[0].by, reason=" and ".join(stop.reason for stop in held))


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0):
        raise PolicyError(f"{name} is {value}; it must be above 0")
    return float(value)


def _at_least_one(name: str, value: int) -> int:
    if value < 1:
        raise PolicyError(f"{name} is {value}; it must be at least 1")
    return int(value)
