"""The scripted demonstrator: lowers, brakes, lays diagonally, drags the wrinkles out while it watches the contact.

It may look at the mesh (a person sees the whole cloth); what it does in the drag depends on the camera's contact
portion, so that the same place occurs with different contact and different speed: from that a GP learns to react.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, GroundTruth, Observation
from layflat.policy.base import Decision

TOUCH_HEIGHT_M = 0.012
"""The free edge counts as touching below this height."""
BRAKE_ABOVE_M = 0.06
DESCEND_STEP_M = 0.010
TRAIL_STEP_M = (0.012, 0.004)
"""Forward and down in one step while the free edge begins to touch."""
TRAIL_M = 0.05
"""The edge trails once it is this far behind the holder."""
LAY_STEP_M = 0.012
REACH = (0.91, 0.985)
"""How much of the cloth's length the lay covers: what is left is slack, to be dragged out."""
SMALL_M = 0.30
"""A cloth shorter than this is laid more tautly, see TAUT."""
TAUT = 0.82
"""Least distance of the held from the free edge while a small cloth is laid, as a share of its length. Straight to its
goal the holder leaves up to 28 % slack on the way. A napkin's then bulges up to the hem while that is still in the air,
and turns it over: it lands behind the held edge and stays folded (3 of 10 demonstrations)."""
LAND_GAIN = 0.3
LAND_STEP_M = 0.0015
ASIDE_X_M = (-0.07, 0.08)
"""Where along x the descent begins, drawn for each demonstration. It spreads few demonstrations over all starts; and
from one place everything that follows would happen at the same x, so that a learner could not tell what was done
because of x from what was done because of contact."""
ASIDE_STEP_M = (0.008, 0.004)
"""Sideways and down in one step on the way there."""
ASIDE_STEPS = 12
TREMOR_M = 0.0015
TREMOR_MEMORY = 0.8
"""A hand wanders by about 2 mm a step, for about 5 steps to the same side; what follows shows how to come back.
Without it five demonstrations lie on one narrow path, and a policy that leaves it never returns."""
STEADY_M = 0.10
HELD_HEIGHT_M = 0.005
DRAG_STEP_M = (0.004, 0.010)
DRAG_GAIN_M = 0.06
FLAT_CONTACT = 0.98
GAIN_STEPS = 12
DRAG_LIMIT_M = 0.10
HOLD_STEPS = 12
ALIGN_STEP_M = 0.006


class ScriptedDemonstrator:
    """Phases: aside, descend until the free edge trails behind, lay, drag until flat, hold.

    Parameters
    ----------
    robot: hanger or pickers.
    length_m: length of the cloth along x when flat.
    columns: nodes along its free edge, the first of the mesh.
    look: the simulator's ground truth of now.
    held_width_m: distance at which the corners are to be held.
    """

    name = "scripted"

    def __init__(
        self, robot: RobotSpec, *, length_m: float, columns: int, held_width_m: float, look: Callable[[], GroundTruth]
    ) -> None:
        self.robot = robot
        self._length_m = length_m
        self._columns = columns
        self._held_width_m = held_width_m
        self._look = look
        self.reset(0)

    def reset(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 0xE0])
        self._reach = float(rng.uniform(*REACH))  # how much of the cloth's length the lay covers
        self._rng = rng
        self._tremor = np.zeros(2)
        self._aside_x = float(rng.uniform(*ASIDE_X_M))
        self._aside_steps = 0
        self._phase = "aside"
        self.resume()

    def resume(self) -> None:
        self._best = -np.inf
        self._since_gain = 0
        self._held = 0
        self._drag_from_x: float | None = None
        if self._phase == "hold":
            self._phase = "drag"

    def act(self, observation: Observation) -> Decision:
        if self._phase == "aside":
            to_go, self._aside_steps = self._aside_x - float(observation.holder_position[0]), self._aside_steps + 1
            if abs(to_go) > ASIDE_STEP_M[0] and self._aside_steps <= ASIDE_STEPS:
                dx, dz = np.sign(to_go) * ASIDE_STEP_M[0], -ASIDE_STEP_M[1]
                return self._decide(observation, float(dx), dz, "going to where the descent begins")
            self._phase = "descend"
        if self._phase == "descend":
            edge = self._look().nodes[: self._columns]
            if float(observation.holder_position[0] - edge[:, 0].max()) < TRAIL_M or edge[:, 2].min() > TOUCH_HEIGHT_M:
                return self._descend(observation, float(edge[:, 2].min()))
            self._phase = "lay"
        if self._phase == "lay":
            height = float(observation.holder_position[2]) - HELD_HEIGHT_M
            if height > 0.002:
                return self._decide(observation, *self._lay(observation, height), "laying")
            self._phase = "drag"
        if self._phase == "drag":
            return self._drag(observation)
        return self._hold(observation)

    def _descend(self, observation: Observation, lowest_m: float) -> Decision:
        """Lower fast, then slower and ever more to the front, so that the free edge touches and trails behind.

        An edge that lands before the holder is laid upon: 13 of 20 starts ended folded without this. Speed depends on
        height alone and never pauses, so that a policy that sees only the holder's place can learn it.
        """
        high = float(np.clip((lowest_m - TOUCH_HEIGHT_M) / BRAKE_ABOVE_M, 0.0, 1.0))
        dx = (1.0 - high) * TRAIL_STEP_M[0]
        dz = TRAIL_STEP_M[1] + high * (DESCEND_STEP_M - TRAIL_STEP_M[1])
        return self._decide(observation, dx, -dz, "descending" if high > 0 else "trailing the free edge")

    def _lay(self, observation: Observation, height: float) -> tuple[float, float]:
        """Straight towards where the held edge belongs, seen from where the free edge lies now: (dx, dz) m."""
        free_edge_x = float(self._look().nodes[: self._columns, 0].mean())
        to_go = np.array([free_edge_x + self._reach * self._length_m - observation.holder_position[0], -height])
        dx, dz = to_go * min(1.0, LAY_STEP_M / float(np.linalg.norm(to_go)))
        # The last centimetres are rounded off into the drag: a corner in the path is what a smooth kernel learns worst.
        dx, dz = float(max(dx, DRAG_STEP_M[0])), float(max(dz, -max(LAND_GAIN * height, LAND_STEP_M)))
        if self._length_m >= SMALL_M:
            return dx, dz
        laid = float(observation.holder_position[0]) - free_edge_x
        return _tautly(dx, dz, laid, height, TAUT * self._length_m)

    def _drag(self, observation: Observation) -> Decision:
        contact, x = observation.contact_portion, float(observation.holder_position[0])
        if self._drag_from_x is None:
            self._drag_from_x = x
        if contact > self._best + 0.003:
            self._best, self._since_gain = contact, 0
        else:
            self._since_gain += 1
        if contact >= FLAT_CONTACT or self._since_gain >= GAIN_STEPS or x - self._drag_from_x > DRAG_LIMIT_M:
            self._phase = "hold"
            return self._hold(observation)
        dx = float(np.clip(DRAG_GAIN_M * (1.0 - contact), *DRAG_STEP_M))
        return self._decide(observation, dx, 0.0, "dragging the wrinkles out")

    def _hold(self, observation: Observation) -> Decision:
        self._held += 1
        done = self._held > HOLD_STEPS
        zeros = self.robot.zeros()
        return Decision(action=zeros, stop="converged" if done else None, reason="flat" if done else "holding")

    def _decide(self, observation: Observation, dx: float, dz: float, reason: str) -> Decision:
        if self._phase in ("aside", "descend", "lay"):
            fresh = self._rng.normal(0.0, TREMOR_M * np.sqrt(1.0 - TREMOR_MEMORY**2), 2)
            self._tremor = TREMOR_MEMORY * self._tremor + fresh
            # Near the table a person's hand is steadied by what it touches.
            dx, dz = np.array([dx, dz]) + self._tremor * min(1.0, float(observation.holder_position[2]) / STEADY_M)
        if self.robot.n_points == 1:
            return Decision(action=np.array([dx, dz]), reason=reason)
        # Two pickers: the same move, and each drifts back to its own line, level with the other.
        centre = observation.holder_position
        home = centre + np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]) * self._held_width_m / 2
        home[:, 1] -= centre[1]
        align = np.clip(home - observation.corner_positions, -ALIGN_STEP_M, ALIGN_STEP_M)
        action = (np.array([dx, 0.0, dz]) + align).ravel()
        return Decision(action=np.clip(action, -ACTION_LIMIT_M, ACTION_LIMIT_M), reason=reason)


def _tautly(dx: float, dz: float, laid: float, height: float, taut: float) -> tuple[float, float]:
    """(dx, dz) m, further to the front where the held edge would come nearer to the free edge than ``taut``.

    ``laid``, ``height``: from the free edge to the held one, along x and up, m. No step gets longer than LAY_STEP_M,
    and the descent never pauses.
    """
    low = max(height + dz, 0.0)
    ahead = float(np.sqrt(max(taut**2 - low**2, 0.0))) - laid
    if ahead <= dx:
        return dx, dz
    ahead = min(ahead, LAY_STEP_M)
    return ahead, -max(min(-dz, float(np.sqrt(LAY_STEP_M**2 - ahead**2))), LAND_STEP_M)
