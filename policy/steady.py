"""Steady: a cloth that swings is not laid down, since its free edge would land on its reverse side (figure 5-1).

Any policy can be decorated. While the cloth hangs low, and the camera sees its free edge ahead of the holder or on its
way there, the holder goes up by as much as it may in a tick; the policy goes on when the cloth hangs still.
"""

from __future__ import annotations

import numpy as np

from data.types import ACTION_LIMIT_M, FloatArray, Observation, Task, action_size
from policy.base import Decision, Policy

LOW_M = 0.05
"""Height of the free edge below which it matters where the edge is."""
AHEAD_M = 0.03
"""Free edge this far ahead of the holder."""
CLEAR_M = 0.06
STILL_TICKS = 5
STILL_M = 0.012
WAIT_TICKS = 40
ON_TABLE_CONTACT = 0.02


class Steady:
    """Acts as ``policy``, but lifts a cloth that swings ahead before it touches, and waits until it hangs still."""

    def __init__(self, policy: Policy) -> None:
        self.name = f"{policy.name}+steady"
        self.task: Task = policy.task
        self.extra_ticks = WAIT_TICKS + int(getattr(policy, "extra_ticks", 0))
        self._policy = policy
        self.reset(0)

    def reset(self, seed: int) -> None:
        self._policy.reset(seed)
        self._waited = 0
        self._waiting = False
        self._offsets: list[float] = []

    def resume(self) -> None:
        self._policy.resume()

    def act(self, observation: Observation) -> Decision:
        low = observation.lowest_m
        if low is None or self._waited >= WAIT_TICKS:
            return self._policy.act(observation)
        ahead = float(low[0] - observation.holder_position[0])
        self._offsets.append(ahead)
        hanging = observation.contact_portion < ON_TABLE_CONTACT and observation.holder_position[2] > 0.15
        if self._waiting:
            recent = self._offsets[-STILL_TICKS:]
            if max(recent) - min(recent) < STILL_M and low[2] > 0.02:
                self._waiting = False
        elif hanging and low[2] < LOW_M and ahead > AHEAD_M:
            self._waiting = True
        if not self._waiting:
            return self._policy.act(observation)
        self._waited += 1
        rise = float(np.clip(CLEAR_M - low[2], 0.0, ACTION_LIMIT_M))
        return Decision(action=_up(self.task, rise), reason="the cloth swings: waiting until it hangs still")


def _up(task: Task, rise_m: float) -> FloatArray:
    action = np.zeros(action_size(task))
    action[1 if task == "hanger" else 2 :: 2 if task == "hanger" else 3] = rise_m
    return action
