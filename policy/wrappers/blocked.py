"""UnblockingPolicy: raises a held edge that is stuck, and draws it to the front before the policy continues.

A stiff cloth that is laid with slack bulges ahead of the held edge, which then rests on the bulge and can only rise.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Observation
from layflat.policy.base import Decision, Policy, continue_after_disturbance, max_extra_steps

BLOCKED_STEPS, STILL_M, WANTED_M = 3, 0.001, 0.003
"""Steps in which the holder moved less than this in each, although so much was asked for."""
MOVES_M = ((0.0, 0.012),) * 4 + ((0.012, 0.0),) * 4
"""x and z of the holder in each step that frees it."""
TRIES = 3
LAID_M = 0.015
"""A held edge below this lies on the table: it is not on a bulge, but at the border of the workspace."""


class UnblockingPolicy:
    """Acts as ``policy`` until the holder is stuck, frees it, and lets the policy continue, at most TRIES times.

    The steps for it count among those of the episode: the limit of a task or a caller holds.
    """

    def __init__(self, policy: Policy) -> None:
        self.name, self.robot = policy.name, policy.robot
        self.max_extra_steps = max_extra_steps(policy)
        self._policy = policy
        self._begin()

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        self._policy.reset(seed)
        self._begin()

    def continue_after_disturbance(self) -> None:
        """Prepare the policy to continue."""
        continue_after_disturbance(self._policy)
        self._begin()

    def _begin(self) -> None:
        self._left, self._moves = TRIES, list[tuple[float, float]]()
        self._forget()

    def _forget(self) -> None:
        self._still: deque[bool] = deque(maxlen=BLOCKED_STEPS)
        self._before: tuple[FloatArray, float] | None = None

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        at = observation.holder_position
        if self._before is not None:
            place, wanted = self._before
            self._still.append(at[2] > LAID_M and wanted > WANTED_M and float(np.linalg.norm(at - place)) < STILL_M)
        if not self._moves and self._left and len(self._still) == BLOCKED_STEPS and all(self._still):
            self._left, self._moves = self._left - 1, list(MOVES_M)
        if self._moves:
            (dx, dz), self._moves = self._moves[0], self._moves[1:]
            self._forget()
            return Decision(action=self.robot.pack([dx, 0.0, dz]), reason="freeing the held edge")
        decision = self._policy.act(observation)
        self._before = at, float(np.abs(decision.action).max())
        return decision
