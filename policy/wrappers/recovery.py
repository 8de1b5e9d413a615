"""Recovery: what a policy has left folded is turned over at the held edge, or lifted, wiped over the table, laid again.

A fold hides cloth, and no pull at the held edge brings it out: contact stays where it is while nothing is left to be
pulled out (section 5-1). Section 5-3 proposes to lift the cloth and to lay it down again. Any policy can be decorated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, Policy, extra_steps

TRIES = 4
"""Times that the cloth is turned or lifted before the policy's stop is accepted."""
FLAT_CONTACT = 0.97
PLATEAU_STEPS = 24
"""Contact is compared between the two halves of so many steps; in a single step its noise is 0.01."""
PLATEAU_GAIN = 0.005
PLATEAU_FROM = 0.3
SMOOTH_STEPS = 10
SMOOTH_STRENGTH = 0.012
"""Where cloth is missing and no wrinkle is seen (mean strength of WORD below this), so long a plateau is enough:
wrinkles have 0.014 to 0.136 (10th to 90th percentile, n = 52), folds 0 to 0.058 (n = 60)."""
STUCK_STEPS = 25
STUCK_M = 0.02
"""A holder that has stayed within this while most of the cloth is in the air is stuck."""
PLACE_STEPS = 160
TURN_CONTACT = (0.85, 0.935)
"""As much as lies when the strip beside the held edge was laid over backwards: a row of the mesh, 0.91 to 0.925."""
TURN_M = ((0.0, 0.010),) * 5 + ((0.012, 0.004),) * 2 + ((0.012, -0.004),) * 2 + ((0.006, -0.010),) * 5
"""x and z of the holder in each step: over the strip, as one turns a page."""
HOME_X_M = 0.0
"""Where a placing begins."""
CLEAR_M = 0.11
"""Height of the lowest part of a cloth that hangs in the air."""
TOP_M = 0.53
LIFT_M = 0.012
BACK_M = 0.010
GATHER_M = 0.001
"""By how much a move may grow in one step: 0.1 m/s^2 hardly make a cloth swing."""
NEAR_M = 0.01
LIFT_STEPS = 90
WIPE_BELOW_M = 0.035
"""How much of a hanging cloth is let down onto the table to be wiped over it."""
WIPE_M = 0.12
"""How far: friction draws out a corner that stays tucked in however the cloth is shaken in the air."""
WIPE_STEP_M = 0.010
SETTLE_STEPS = 40
STILL_STEPS = 8
STILL_M = 0.012
"""Range of the lowest part's place beside the holder, x."""


class RecoveryWrapper:
    """Acts as ``policy``; where that ends over a fold, undoes the fold and lets it go on, at most ``tries`` times."""

    def __init__(self, policy: Policy, *, tries: int = TRIES) -> None:
        self.name = f"{policy.name}+recovery"
        self.robot = policy.robot
        self.extra_steps = extra_steps(policy) + tries * (2 * LIFT_STEPS + SETTLE_STEPS + PLACE_STEPS)
        self._policy = policy
        self._tries = tries
        self._seed = 0
        self._corners: FloatArray | None = None
        """(2, 3) m: from the holder's place to the corners, side by side and as far apart as they ever were.

        A hem that hangs slack between two pickers, or aslant, folds at one of them, and no lift to there unfolds it.
        """
        self._begin()

    def reset(self, seed: int) -> None:
        self._seed, self._corners = seed, None
        self._policy.reset(seed)
        self._begin()

    def resume(self) -> None:
        self._policy.resume()
        self._begin()

    def _begin(self) -> None:
        self.tried: list[str] = []
        """What has been tried since the start or the last disturbance: "turn", "lift" or "wipe"."""
        self._watch()

    def _watch(self) -> None:
        """Nothing is known of how the policy gets on from here."""
        self._undoing: Iterator[Decision] | None = None
        self._n_steps = 0
        self._contacts: deque[float] = deque(maxlen=PLATEAU_STEPS)
        self._strengths: deque[float] = deque(maxlen=SMOOTH_STEPS)
        self._places: deque[FloatArray] = deque(maxlen=STUCK_STEPS)

    def act(self, observation: Observation) -> Decision:
        self._seen = observation
        apart = observation.corner_positions - observation.holder_position
        if self._corners is None:
            self._corners = apart * [0.0, 1.0, 0.0]
        elif np.ptp(apart[:, 1]) > np.ptp(self._corners[:, 1]):
            self._corners[:, 1] = apart[:, 1]
        if self._undoing is not None:
            undone = next(self._undoing, None)
            if undone is not None:
                return undone
            self._watch()
        decision = self._policy.act(observation)
        if len(self.tried) == self._tries or not self._folded(decision):
            return decision
        if TURN_CONTACT[0] <= observation.contact_portion <= TURN_CONTACT[1] and self.tried[-1:] != ["turn"]:
            self.tried.append("turn")
            self._undoing = self._turn()
        else:
            self.tried.append("wipe" if "lift" in self.tried else "lift")
            self._undoing = self._lift(wipe=self.tried[-1] == "wipe")
        return next(self._undoing, decision)

    def _folded(self, decision: Decision) -> bool:
        """Whether the policy has come to its end, or nowhere, with cloth hidden; takes note of this step."""
        seen = self._seen
        self._n_steps += 1
        self._contacts.append(seen.contact_portion)
        self._strengths.append(seen.word_strength)
        self._places.append(seen.holder_position)
        ended = decision.stop is not None or self._n_steps > PLACE_STEPS
        smooth = len(self._strengths) == SMOOTH_STEPS and np.mean(self._strengths) < SMOOTH_STRENGTH
        ended = ended or self._plateau(PLATEAU_STEPS) or (bool(smooth) and self._plateau(SMOOTH_STEPS))
        if len(self._places) == STUCK_STEPS and seen.contact_portion < PLATEAU_FROM:
            ended = ended or bool(np.ptp(np.array(self._places), axis=0).max() < STUCK_M)
        return ended and seen.contact_portion < FLAT_CONTACT

    def _plateau(self, n_steps: int) -> bool:
        """Whether most of the cloth lay in the last ``steps`` steps, and their second half gained next to nothing."""
        last = list(self._contacts)[-n_steps:]
        if len(last) < n_steps or min(last) <= PLATEAU_FROM:
            return False
        before, after = np.array(last).reshape(2, -1).mean(axis=1)
        return bool(after - before < PLATEAU_GAIN)

    def _turn(self) -> Iterator[Decision]:
        for dx, dz in TURN_M:
            yield self._move(dx, dz, "turning the held edge over")
        self._policy.resume()

    def _lift(self, *, wipe: bool) -> Iterator[Decision]:
        """Up into the air, and once more after a wipe over the table; then wait until the cloth hangs still."""
        yield from self._rise()
        if wipe:
            yield from self._wipe()
            yield from self._rise()
        offsets: deque[float] = deque(maxlen=STILL_STEPS)
        for _ in range(SETTLE_STEPS):
            if self._seen.free_edge_m is not None:
                offsets.append(float(self._seen.free_edge_m[0] - self._seen.holder_position[0]))
            if len(offsets) == STILL_STEPS and np.ptp(offsets) < STILL_M:
                break
            yield self._move(0.0, 0.0, "letting the cloth hang still")
        self._policy.reset(self._seed)

    def _wipe(self) -> Iterator[Decision]:
        low = self._seen.free_edge_m
        down = WIPE_BELOW_M + (CLEAR_M if low is None else float(low[2]))
        for k in range(int(np.ceil(down / LIFT_M))):
            yield self._move(0.0, -LIFT_M * min(1.0, (k + 1) / 4), "letting the free edge down")
        for _ in range(round(WIPE_M / WIPE_STEP_M)):
            yield self._move(WIPE_STEP_M, 0.0, "wiping the free edge over the table")

    def _rise(self) -> Iterator[Decision]:
        """Up and back to where a placing begins, without a jerk."""
        speed = np.zeros(2)
        for _ in range(LIFT_STEPS):
            place, low = self._seen.holder_position, self._seen.free_edge_m
            rise = min(CLEAR_M - (CLEAR_M if low is None else float(low[2])), TOP_M - float(place[2]))
            back = HOME_X_M - float(place[0])
            if max(rise, abs(back)) < NEAR_M:
                break
            wanted = np.clip([0.2 * back, 0.2 * rise], [-BACK_M, -LIFT_M], [BACK_M, LIFT_M])
            speed = speed + np.clip(wanted - speed, -GATHER_M, GATHER_M)
            yield self._move(float(speed[0]), float(speed[1]), "lifting the cloth off a fold")

    def _move(self, dx: float, dz: float, reason: str) -> Decision:
        """The whole holder; two pickers come back to their places side by side as well."""
        if self.robot.n_points == 1:
            return Decision(action=self.robot.pack([dx, 0.0, dz]), reason=reason)
        assert self._corners is not None
        apart = self._seen.corner_positions - self._seen.holder_position
        step = np.array([dx, -self._seen.holder_position[1], dz]) + self._corners - apart
        return Decision(action=self.robot.pack(np.clip(step, -ACTION_LIMIT_M, ACTION_LIMIT_M)), reason=reason)
