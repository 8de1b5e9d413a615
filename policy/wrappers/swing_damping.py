"""SwingDampingWrapper (``steady``): keeps a cloth that swings ahead of its holder in the air until it hangs still.

Laid down while it swings ahead, it would land on its reverse side (figure 5-1). While the cloth hangs low and the
camera sees its free edge ahead of the holder, the holder stays where it is and rises as fast as it may.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, Policy, continue_after_disturbance, max_extra_steps

LOW_M = 0.05
"""Height of the free edge below which its x matters."""
AHEAD_M = 0.03
"""The demonstrator's free edge is behind the holder when it touches; random moves of a start swing it 1 cm ahead."""
CLEAR_M = 0.06
"""Height to which the free edge is lifted."""
HANGING_CONTACT, HELD_UP_M = 0.02, 0.15
"""Camera contact below which, and height of the holder above which, a cloth hangs."""
STILL_STEPS, STILL_M = 5, 0.012
"""Steps, and range of the free edge's x relative to the holder: the camera's noise and a swing of 6 mm."""
WAIT_STEPS = 40
"""Most steps of waiting in an episode; air drag stops a swing in a second or two."""


class SwingDampingWrapper:
    """Acts as ``policy``, but lifts a cloth that swings ahead before it touches, and waits until it hangs still."""

    def __init__(self, policy: Policy) -> None:
        self.name, self.robot = f"{policy.name}+steady", policy.robot
        self.max_extra_steps = max_extra_steps(policy) + WAIT_STEPS
        self._policy = policy
        self._clear()

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        self._policy.reset(seed)
        self._clear()

    def _clear(self) -> None:
        self._waited, self._waiting = 0, False
        self._ahead: deque[float] = deque(maxlen=STILL_STEPS)

    def continue_after_disturbance(self) -> None:
        """Prepare the policy to continue."""
        continue_after_disturbance(self._policy)

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        free_edge = observation.free_edge_m
        if free_edge is None or self._waited == WAIT_STEPS:
            return self._policy.act(observation)
        ahead = float(free_edge[0] - observation.holder_position[0])
        self._ahead.append(ahead)
        hanging = observation.contact_portion < HANGING_CONTACT and observation.holder_position[2] > HELD_UP_M
        if self._waiting:
            self._waiting = len(self._ahead) < STILL_STEPS or float(np.ptp(self._ahead)) > STILL_M
        else:
            self._waiting = bool(hanging and free_edge[2] < LOW_M and ahead > AHEAD_M)
        if not self._waiting:
            return self._policy.act(observation)
        self._waited += 1
        rise = float(np.clip(CLEAR_M - free_edge[2], 0.0, ACTION_LIMIT_M))
        reason = "the cloth swings ahead: waiting until it hangs still"
        return Decision(action=self.robot.pack([0.0, 0.0, rise]), reason=reason)
