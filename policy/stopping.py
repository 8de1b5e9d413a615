"""Stop rules, which decide when a policy has finished, and the base class of policies that a rule ends.

A rule is updated exactly once per step and reports whether to stop at that step. It is reset at the start of an episode
and when a policy continues after a disturbance.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import Observation, StoppedBy
from layflat.policy.base import Decision, PolicyError

X_LIMIT_M = 0.75
"""World x at which the camera's view ends."""


class Stop(NamedTuple):
    """Reason to stop: a word for files, and an explanation for people."""

    by: StoppedBy
    reason: str


class StopRule(Protocol):
    """One reason to stop."""

    def reset(self) -> None:
        """Forget all steps so far."""

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        """Count one step with ``action`` (A,) m; return a Stop as long as the condition holds, else None."""


class Sustained:
    """Stops when a condition holds for ``n_steps`` steps in a row."""

    def __init__(self, condition: Callable[[Observation, FloatArray], bool], stop: Stop, *, n_steps: int) -> None:
        self._condition, self._stop = condition, stop
        self._n_steps = positive("n_steps", n_steps)
        self._count = 0

    def reset(self) -> None:
        """Forget all steps so far."""
        self._count = 0

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        """Count one step."""
        self._count = self._count + 1 if self._condition(observation, action) else 0
        return self._stop if self._count >= self._n_steps else None


def below_threshold(threshold_m: float, *, n_steps: int = 1) -> StopRule:
    """Stop when the norm of the action is below ``threshold_m`` for ``n_steps`` steps (thesis, chapter 4-2-3).

    The thesis stops at the first such step. More steps keep a pause between two moves from ending the episode.
    """
    least = positive("threshold_m", threshold_m)
    stop = Stop("threshold", f"output below {1000 * least:g} mm for {n_steps} steps")
    return Sustained(lambda _, action: float(np.linalg.norm(action)) < least, stop, n_steps=n_steps)


def contact_reached(contact: float, *, n_steps: int = 1) -> StopRule:
    """Stop when the contact portion is at least ``contact`` for ``n_steps`` steps."""
    least = positive("contact", contact)
    stop = Stop("converged", f"contact portion has reached {least:g}")
    return Sustained(lambda observation, _: observation.contact_portion >= least, stop, n_steps=n_steps)


def x_limit(x_m: float = X_LIMIT_M) -> StopRule:
    """Stop when the holder is at or beyond world ``x_m``: the end of the camera's view and of the arm's reach.

    In files it counts as ``step_limit``; the reason says which limit it is.
    """
    stop = Stop("step_limit", f"holder has reached the limit x = {x_m:g} m")
    return Sustained(lambda observation, _: bool(observation.holder_position[0] >= x_m), stop, n_steps=1)


class NoContactGain:
    """Stops when the best contact portion so far does not rise by ``gain`` for ``n_steps`` steps.

    Counting begins when the contact portion reaches ``from_contact``: a cloth that still hangs in the air gains no
    contact, and must not end the episode.
    """

    def __init__(self, *, n_steps: int, gain: float = 0.002, from_contact: float = 0.0) -> None:
        self._n_steps, self._gain = positive("n_steps", n_steps), positive("gain", gain)
        self._from_contact = from_contact
        self.reset()

    def reset(self) -> None:
        """Forget all steps so far."""
        self._best: float | None = None
        self._count = 0

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        """Count one step."""
        contact = observation.contact_portion
        if self._best is None:
            self._best = contact if contact >= self._from_contact else None
        elif contact >= self._best + self._gain:
            self._best, self._count = contact, 0
        else:
            self._count += 1
        stop = Stop("converged", f"no gain of contact for {self._n_steps} steps")
        return stop if self._count >= self._n_steps else None


class Stuck:
    """Stops when the holder stays within ``within_m`` along each axis for ``n_steps`` steps: nothing yields."""

    def __init__(self, *, n_steps: int, within_m: float) -> None:
        self._within_m = positive("within_m", within_m)
        self._positions: deque[FloatArray] = deque(maxlen=int(positive("n_steps", n_steps)))

    def reset(self) -> None:
        """Forget all steps so far."""
        self._positions.clear()

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        """Count one step."""
        self._positions.append(observation.holder_position)
        n_steps = self._positions.maxlen
        if len(self._positions) != n_steps or np.ptp(np.array(self._positions), axis=0).max() >= self._within_m:
            return None
        return Stop("converged", f"holder has stayed within {1000 * self._within_m:g} mm for {n_steps} steps")


class AnyOf:
    """Stops when one of the rules does, for the reason of the first of them."""

    def __init__(self, *rules: StopRule) -> None:
        self._rules = rules

    def reset(self) -> None:
        """Reset all rules."""
        for rule in self._rules:
            rule.reset()

    def update(self, observation: Observation, action: FloatArray) -> Stop | None:
        """Count one step in every rule, also in those after the first that stops."""
        stops = [rule.update(observation, action) for rule in self._rules]
        return next((stop for stop in stops if stop is not None), None)


class RuleStoppedPolicy:
    """Base of policies that act until their stop rule ends the episode."""

    def __init__(self, name: str, robot: RobotSpec, stop: StopRule) -> None:
        self.name, self.robot = name, robot
        self._stop = stop

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        self._stop.reset()

    def continue_after_disturbance(self) -> None:
        """Restart the stop rule."""
        self._stop.reset()

    def _decide(
        self,
        observation: Observation,
        action: FloatArray,
        reason: str,
        *,
        std: FloatArray | None = None,
        output: FloatArray | None = None,
    ) -> Decision:
        """Return ``action``, or a stop if the rule says so for ``output`` (by default the action)."""
        stop = self._stop.update(observation, action if output is None else output)
        if stop is not None:
            return Decision(action=np.zeros_like(action), std=std, stop=stop.by, reason=stop.reason)
        return Decision(action=action, std=std, reason=reason)


def positive(name: str, value: float, most: float = math.inf) -> float:
    """Return a parameter; PolicyError unless it is finite, above 0 and at most ``most``."""
    if not (np.isfinite(value) and 0 < value <= most):
        limit = "" if most == math.inf else f" and at most {most}"
        raise PolicyError(f"{name} is {value}; it must be above 0{limit}")
    return value
