"""RecoveryWrapper: undoes a fold that a policy has left, and lets the policy lay the cloth again.

A fold hides cloth that no pull at the held edge brings out (section 5-1). Section 5-3 proposes to lift the cloth and
to lay it down again. Here the held edge is turned over, or the cloth is lifted, or lifted and wiped over the table.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, Policy, continue_after_disturbance, max_extra_steps

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
STUCK_STEPS, STUCK_M = 25, 0.02
"""A holder that has stayed within this while most of the cloth is in the air is stuck."""
PLACE_STEPS = 160
TURN_CONTACT = (0.85, 0.935)
"""Contact if the strip beside the held edge was laid over backwards: a row of the mesh, 0.91 to 0.925."""
TURN_M = ((0.0, 0.010),) * 5 + ((0.012, 0.004),) * 2 + ((0.012, -0.004),) * 2 + ((0.006, -0.010),) * 5
"""x and z of the holder in each step: over the strip, as one turns a page."""
HOME_X_M = 0.0
"""x at which a placing begins."""
CLEAR_M = 0.11
"""Height of the free edge of a cloth that hangs in the air."""
TOP_M, LIFT_M, BACK_M = 0.53, 0.012, 0.010
GATHER_M = 0.001
"""Most by which a move may grow in one step: 0.1 m/s^2 hardly make a cloth swing."""
NEAR_M, LIFT_STEPS = 0.01, 90
WIPE_BELOW_M = 0.035
"""Part of a hanging cloth that is let down onto the table to be wiped over it."""
WIPE_M = 0.12
"""Length of a wipe: friction draws out a corner that stays tucked in when the cloth is only shaken in the air."""
WIPE_STEP_M = 0.010
SETTLE_STEPS = 40
STILL_STEPS, STILL_M = 8, 0.012
"""Steps, and range of the free edge's x relative to the holder."""


class RecoveryWrapper:
    """Acts as ``policy``; where it ends over a fold, undoes the fold and lets it continue, at most ``tries`` times."""

    def __init__(self, policy: Policy, *, tries: int = TRIES) -> None:
        self.name, self.robot = f"{policy.name}+recovery", policy.robot
        self.max_extra_steps = max_extra_steps(policy) + tries * (2 * LIFT_STEPS + SETTLE_STEPS + PLACE_STEPS)
        self._policy, self._tries, self._seed = policy, tries, 0
        self._corners = np.zeros((2, 3))
        """(2, 3) m: from the holder to the corners, side by side and as far apart as they ever were: a hem that hangs
        slack or aslant between two pickers folds at one of them, and no lift unfolds it."""
        self._begin()

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        self._seed, self._corners = seed, np.zeros((2, 3))
        self._policy.reset(seed)
        self._begin()

    def continue_after_disturbance(self) -> None:
        """Prepare the policy to continue, and allow all tries again."""
        continue_after_disturbance(self._policy)
        self._begin()

    def _begin(self) -> None:
        self.tried: list[str] = []
        """Tries since the start or the last disturbance: "turn", "lift" or "wipe"."""
        self._watch()

    def _watch(self) -> None:
        """Begin to watch the policy, without any memory of earlier steps."""
        self._recovery: Iterator[Decision] | None = None
        self._n_steps = 0
        self._contacts: deque[float] = deque(maxlen=PLATEAU_STEPS)
        self._strengths: deque[float] = deque(maxlen=SMOOTH_STEPS)
        self._positions: deque[FloatArray] = deque(maxlen=STUCK_STEPS)

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        self._observation = observation
        apart = observation.corner_positions - observation.holder_position
        if not self._corners.any():
            self._corners = apart * [0.0, 1.0, 0.0]
        elif np.ptp(apart[:, 1]) > np.ptp(self._corners[:, 1]):
            self._corners[:, 1] = apart[:, 1]
        if self._recovery is not None:
            move = next(self._recovery, None)
            if move is not None:
                return move
            self._watch()
        decision = self._policy.act(observation)
        if len(self.tried) == self._tries or not self._folded(decision):
            return decision
        if TURN_CONTACT[0] <= observation.contact_portion <= TURN_CONTACT[1] and self.tried[-1:] != ["turn"]:
            self.tried.append("turn")
            self._recovery = self._turn()
        else:
            self.tried.append("wipe" if "lift" in self.tried else "lift")
            self._recovery = self._lift(wipe=self.tried[-1] == "wipe")
        return next(self._recovery, decision)

    def _folded(self, decision: Decision) -> bool:
        """Count this step; return whether the policy has ended, or gets nowhere, while cloth is hidden."""
        contact = self._observation.contact_portion
        self._n_steps += 1
        self._contacts.append(contact)
        self._strengths.append(self._observation.word_strength)
        self._positions.append(self._observation.holder_position)
        smooth = len(self._strengths) == SMOOTH_STEPS and bool(np.mean(self._strengths) < SMOOTH_STRENGTH)
        ended = decision.stop is not None or self._n_steps > PLACE_STEPS
        ended = ended or self._plateau(PLATEAU_STEPS) or (smooth and self._plateau(SMOOTH_STEPS))
        if len(self._positions) == STUCK_STEPS and contact < PLATEAU_FROM:
            ended = ended or bool(np.ptp(np.array(self._positions), axis=0).max() < STUCK_M)
        return ended and contact < FLAT_CONTACT

    def _plateau(self, n_steps: int) -> bool:
        """Whether much of the cloth lay in the last steps, and their second half gained next to nothing."""
        last = list(self._contacts)[-n_steps:]
        if len(last) < n_steps or min(last) <= PLATEAU_FROM:
            return False
        before, after = np.array(last).reshape(2, -1).mean(axis=1)
        return bool(after - before < PLATEAU_GAIN)

    def _turn(self) -> Iterator[Decision]:
        for dx, dz in TURN_M:
            yield self._move(dx, dz, "turning the held edge over")
        continue_after_disturbance(self._policy)

    def _lift(self, *, wipe: bool) -> Iterator[Decision]:
        """Lift the cloth, with ``wipe`` once more after a wipe over the table; then wait until it hangs still."""
        yield from self._rise()
        if wipe:
            yield from self._wipe()
            yield from self._rise()
        offsets: deque[float] = deque(maxlen=STILL_STEPS)
        for _ in range(SETTLE_STEPS):
            free_edge = self._observation.free_edge_m
            if free_edge is not None:
                offsets.append(float(free_edge[0] - self._observation.holder_position[0]))
            if len(offsets) == STILL_STEPS and np.ptp(offsets) < STILL_M:
                break
            yield self._move(0.0, 0.0, "letting the cloth hang still")
        self._policy.reset(self._seed)

    def _wipe(self) -> Iterator[Decision]:
        down = WIPE_BELOW_M + self._free_edge_height()
        for k in range(int(np.ceil(down / LIFT_M))):
            yield self._move(0.0, -LIFT_M * min(1.0, (k + 1) / 4), "letting the free edge down")
        for _ in range(round(WIPE_M / WIPE_STEP_M)):
            yield self._move(WIPE_STEP_M, 0.0, "wiping the free edge over the table")

    def _rise(self) -> Iterator[Decision]:
        """Rise and return to where a placing begins, without a jerk."""
        speed = np.zeros(2)
        for _ in range(LIFT_STEPS):
            x, _, z = (float(value) for value in self._observation.holder_position)
            rise = min(CLEAR_M - self._free_edge_height(), TOP_M - z)
            back = HOME_X_M - x
            if max(rise, abs(back)) < NEAR_M:
                break
            wanted = np.clip([0.2 * back, 0.2 * rise], [-BACK_M, -LIFT_M], [BACK_M, LIFT_M])
            speed = speed + np.clip(wanted - speed, -GATHER_M, GATHER_M)
            yield self._move(float(speed[0]), float(speed[1]), "lifting the cloth off a fold")

    def _free_edge_height(self) -> float:
        """Return the free edge's height, m; without a camera that sees it, that of a cloth in the air."""
        free_edge = self._observation.free_edge_m
        return CLEAR_M if free_edge is None else float(free_edge[2])

    def _move(self, dx: float, dz: float, reason: str) -> Decision:
        """Move the whole robot; two points also return to their positions side by side."""
        moves = np.array([dx, 0.0, dz])
        if self.robot.n_points == 1:
            return Decision(action=self.robot.pack(moves), reason=reason)
        apart = self._observation.corner_positions - self._observation.holder_position
        moves[1] = -self._observation.holder_position[1]
        moves = np.clip(moves + self._corners - apart, -ACTION_LIMIT_M, ACTION_LIMIT_M)
        return Decision(action=self.robot.pack(moves), reason=reason)
