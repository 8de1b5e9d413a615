"""Latency: what a policy sees is old, and what it does comes late."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Observation
from layflat.sim.conditions.keys import Conditions


class Latency:
    """Delays observations and actions of one episode by whole steps."""

    def __init__(self, conditions: Conditions, rest: FloatArray) -> None:
        """``rest`` is the action of a robot that has no command yet, (A,) m."""
        self._actions = deque([rest] * conditions.action_latency_steps)
        self._seen: deque[Observation] = deque(maxlen=conditions.observation_latency_steps + 1)

    def action(self, command: FloatArray) -> FloatArray:
        """Return the action to carry out in the step in which ``command`` is given."""
        self._actions.append(np.array(command, dtype=float))
        return self._actions.popleft()

    def observation(self, now: Observation) -> Observation:
        """Return what arrives now: what there was some steps ago, or else at the start."""
        if self._seen and self._seen[-1].time_s == now.time_s:  # Looked at twice in a step.
            self._seen.pop()
        self._seen.append(now)
        return now if len(self._seen) == 1 else replace(self._seen[0], time_s=now.time_s)
