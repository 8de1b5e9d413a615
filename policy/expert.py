"""The scripted demonstrator: lowers, brakes, lays diagonally, drags the wrinkles out while it watches the contact.

It may look at the mesh (a person sees the whole cloth); what it does in the drag depends on the camera's contact
portion, so that the same place occurs with different contact and different speed: from that a GP learns to react.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from data.types import FloatArray, Observation, Task, Truth, action_size
from policy.base import Decision

TOUCH_HEIGHT_M = 0.014
"""The free edge counts as touching below this height."""
BRAKE_TO_M = 0.012
DESCEND_STEP_M = (0.002, 0.010)
TRAIL_M = 0.05
TRAIL_STEP_M = (0.012, -0.0025)
LAY_STEP_M = 0.012
HELD_HEIGHT_M = 0.005
DRAG_STEP_M = (0.003, 0.010)
DRAG_GAIN_M = 0.06
FLAT_CONTACT = 0.975
GAIN_TICKS = 12
DRAG_LIMIT_M = 0.10
HOLD_TICKS = 8
ALIGN_STEP_M = 0.006


class ScriptedExpert:
    """Phases: descend until the free edge touches, lay, drag until flat, hold.

    Parameters
    ----------
    task: hanger or pickers.
    length_m, width_m: size of the cloth, along x and between the held corners.
    look: the simulator's ground truth of now.
    held_width_m: distance at which the corners are to be held.
    """

    name = "scripted"

    def __init__(self, task: Task, *, length_m: float, columns: int, held_width_m: float, look: Callable[[], Truth]) -> None:
        self.task: Task = task
        self._length_m = length_m
        self._columns = columns
        self._held_width_m = held_width_m
        self._look = look
        self.reset(0)

    def reset(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 0xE0])
        self._reach = float(rng.uniform(0.93, 1.0))  # how much of the cloth's length the lay covers
        self._phase = "descend"
        self.resume()

    def resume(self) -> None:
        self._best = -np.inf
        self._since_gain = 0
        self._held = 0
        self._drag_from_x: float | None = None
        if self._phase == "hold":
            self._phase = "drag"

    def act(self, observation: Observation) -> Decision:
        if self._phase == "descend":
            lowest = float(self._look().nodes[:, 2].min())
            if lowest >= TOUCH_HEIGHT_M:
                step = float(np.clip(0.3 * (lowest - BRAKE_TO_M), *DESCEND_STEP_M))
                return self._decide(observation, 0.0, -step, "descending")
            self._phase = "trail"
        if self._phase == "trail":
            edge = self._look().nodes[: self._columns]
            lag = float(observation.holder_position[0] - edge[:, 0].max())
            if lag < TRAIL_M:
                return self._decide(observation, *TRAIL_STEP_M, "trailing the free edge")
            self._phase = "lay"
        if self._phase == "lay":
            height = float(observation.holder_position[2]) - HELD_HEIGHT_M
            if height > 0.003:
                return self._decide(observation, *self._lay(observation, height), "laying")
            self._phase = "drag"
        if self._phase == "drag":
            return self._drag(observation)
        return self._hold(observation)

    def _lay(self, observation: Observation, height: float) -> tuple[float, float]:
        """Straight towards where the held edge belongs, seen from where the free edge lies now: (dx, dz) m."""
        free_edge_x = float(self._look().nodes[: self._columns, 0].mean())
        to_go = np.array([free_edge_x + self._reach * self._length_m - observation.holder_position[0], -height])
        dx, dz = to_go * min(1.0, LAY_STEP_M / float(np.linalg.norm(to_go)))
        return float(dx), float(dz)

    def _drag(self, observation: Observation) -> Decision:
        contact, x = observation.contact_portion, float(observation.holder_position[0])
        if self._drag_from_x is None:
            self._drag_from_x = x
        if contact > self._best + 0.003:
            self._best, self._since_gain = contact, 0
        else:
            self._since_gain += 1
        if contact >= FLAT_CONTACT or self._since_gain >= GAIN_TICKS or x - self._drag_from_x > DRAG_LIMIT_M:
            self._phase = "hold"
            return self._hold(observation)
        dx = float(np.clip(DRAG_GAIN_M * (1.0 - contact), *DRAG_STEP_M))
        return self._decide(observation, dx, 0.0, "dragging the wrinkles out")

    def _hold(self, observation: Observation) -> Decision:
        self._held += 1
        done = self._held > HOLD_TICKS
        zeros = np.zeros(action_size(self.task))
        return Decision(action=zeros, stop="converged" if done else None, reason="flat" if done else "holding")

    def _decide(self, observation: Observation, dx: float, dz: float, reason: str) -> Decision:
        if self.task == "hanger":
            return Decision(action=np.array([dx, dz]), reason=reason)
        # Two pickers: the same move, and each drifts back to its own line, level with the other.
        centre = observation.holder_position
        home = centre + np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]) * self._held_width_m / 2
        home[:, 1] -= centre[1]
        align = np.clip(home - observation.corner_positions, -ALIGN_STEP_M, ALIGN_STEP_M)
        return Decision(action=(np.array([dx, 0.0, dz]) + align).ravel(), reason=reason)
