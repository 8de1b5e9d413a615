"""ScriptedDemonstrator: lowers, brakes, lays diagonally and drags the wrinkles out while it watches the contact.

It may look at the mesh, as a person sees the whole cloth. Its drag depends on the camera's contact portion, so that the
same position occurs with different contact and different speed; from that a Gaussian process learns to react.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, GroundTruth, Observation
from layflat.policy.base import Decision, PolicyError

NO_GROUND_TRUTH = "the scripted demonstrator needs a simulation: it looks at the cloth's mesh"

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
"""Share of the cloth's length that the lay covers, drawn for each demonstration; the rest is slack for the drag."""
SMALL_M = 0.30
"""A cloth shorter than this is laid more tautly, see TAUT."""
TAUT = 0.82
"""Least distance of the held from the free edge while a small cloth is laid, share of its length. Straight to its goal
the holder leaves up to 28 % slack, so that a napkin bulges, turns its hem over in the air and stays folded (3 of 10
demonstrations)."""
LAND_GAIN, LAND_STEP_M = 0.3, 0.0015
ASIDE_X_M = (-0.07, 0.08)
"""Range of x in which the descent begins, drawn for each demonstration: from a single x everything would happen at the
same x, and a learner could not tell what was done because of x from what was done because of contact."""
ASIDE_STEP_M = (0.008, 0.004)
"""Sideways and down in one step on the way there."""
ASIDE_STEPS = 12
TREMOR_M, TREMOR_MEMORY = 0.0015, 0.8
"""A hand wanders by about 2 mm a step, for about 5 steps to the same side, and comes back. Without tremor, five
demonstrations lie on one narrow path, and a policy that leaves it never returns."""
STEADY_M, HELD_HEIGHT_M, ALIGN_STEP_M = 0.10, 0.005, 0.006
DRAG_STEP_M, DRAG_GAIN_M, DRAG_LIMIT_M = (0.004, 0.010), 0.06, 0.10
FLAT_CONTACT, GAIN_STEPS, HOLD_STEPS = 0.98, 12, 12


class ScriptedDemonstrator:
    """Demonstrates in phases: aside, descend until the free edge trails behind, lay, drag until flat, hold.

    The flat cloth is ``length_m`` long along x. ``columns`` is the number of nodes along its free edge, which are the
    first of the mesh; the robot holds the two corners ``held_width_m`` apart. All lengths are for the towel: on another
    cloth it acts in the cloth's frame (`layflat.data.cloth_frame`).
    """

    name = "scripted"

    def __init__(
        self,
        robot: RobotSpec,
        *,
        length_m: float,
        columns: int,
        held_width_m: float,
        ground_truth: Callable[[], GroundTruth | None],
        taut: bool | None = None,
    ) -> None:
        """``taut``: whether the cloth is laid tautly; None: if it is shorter than SMALL_M."""
        self.robot = robot
        self._taut = length_m < SMALL_M if taut is None else taut
        self._length_m, self._columns, self._held_width_m = length_m, columns, held_width_m
        self._ground_truth = ground_truth
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start a new demonstration."""
        self._rng = np.random.default_rng([seed, 0xE0])
        self._reach, self._aside_x = (float(self._rng.uniform(*limits)) for limits in (REACH, ASIDE_X_M))
        self._tremor = np.zeros(2)
        self._phase, self._aside_steps = "aside", 0
        self.continue_after_disturbance()

    def continue_after_disturbance(self) -> None:
        """Drag again if the demonstration was over."""
        self._best, self._since_gain, self._held = -np.inf, 0, 0
        self._drag_from_x: float | None = None
        if self._phase == "hold":
            self._phase = "drag"

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        x, _, z = (float(value) for value in observation.holder_position)
        if self._phase == "aside":
            to_go, self._aside_steps = self._aside_x - x, self._aside_steps + 1
            if abs(to_go) > ASIDE_STEP_M[0] and self._aside_steps <= ASIDE_STEPS:
                dx, dz = np.sign(to_go) * ASIDE_STEP_M[0], -ASIDE_STEP_M[1]
                return self._move(observation, float(dx), dz, "going to where the descent begins")
            self._phase = "descend"
        if self._phase == "descend":
            edge = self._free_edge()
            if x - edge[:, 0].max() < TRAIL_M or edge[:, 2].min() > TOUCH_HEIGHT_M:
                return self._descend(observation, float(edge[:, 2].min()))
            self._phase = "lay"
        if self._phase == "lay":
            height = z - HELD_HEIGHT_M
            if height > 0.002:
                return self._move(observation, *self._lay(x, height), "laying")
            self._phase = "drag"
        if self._phase == "drag":
            return self._drag(observation, x)
        return self._hold()

    def _free_edge(self) -> np.ndarray:
        """Return the nodes of the free edge, (columns, 3) m."""
        truth = self._ground_truth()
        if truth is None:
            raise PolicyError(NO_GROUND_TRUTH)
        return truth.nodes[: self._columns]

    def _descend(self, observation: Observation, lowest_m: float) -> Decision:
        """Lower fast, then slower and more and more to the front, so that the free edge touches and trails behind.

        Without this 13 of 20 starts ended folded. The speed depends on height alone and never pauses, so that a policy
        that sees only the position can learn it.
        """
        high = float(np.clip((lowest_m - TOUCH_HEIGHT_M) / BRAKE_ABOVE_M, 0.0, 1.0))
        dx = (1.0 - high) * TRAIL_STEP_M[0]
        dz = TRAIL_STEP_M[1] + high * (DESCEND_STEP_M - TRAIL_STEP_M[1])
        return self._move(observation, dx, -dz, "descending" if high > 0 else "trailing the free edge")

    def _lay(self, x: float, height: float) -> tuple[float, float]:
        """Return (dx, dz) m straight to the final position of the held edge, as seen from the free edge."""
        free_edge_x = float(self._free_edge()[:, 0].mean())
        to_go = np.array([free_edge_x + self._reach * self._length_m - x, -height])
        dx, dz = to_go * min(1.0, LAY_STEP_M / float(np.linalg.norm(to_go)))
        # The last centimetres are rounded off into the drag: a smooth kernel learns a corner in the path worst.
        dx, dz = float(max(dx, DRAG_STEP_M[0])), float(max(dz, -max(LAND_GAIN * height, LAND_STEP_M)))
        return keep_taut(dx, dz, x - free_edge_x, height, TAUT * self._length_m) if self._taut else (dx, dz)

    def _drag(self, observation: Observation, x: float) -> Decision:
        contact = observation.contact_portion
        if self._drag_from_x is None:
            self._drag_from_x = x
        if contact > self._best + 0.003:
            self._best, self._since_gain = contact, 0
        else:
            self._since_gain += 1
        if contact >= FLAT_CONTACT or self._since_gain >= GAIN_STEPS or x - self._drag_from_x > DRAG_LIMIT_M:
            self._phase = "hold"
            return self._hold()
        dx = float(np.clip(DRAG_GAIN_M * (1.0 - contact), *DRAG_STEP_M))
        return self._move(observation, dx, 0.0, "dragging the wrinkles out")

    def _hold(self) -> Decision:
        self._held += 1
        if self._held > HOLD_STEPS:
            return Decision(action=self.robot.zeros(), stop="converged", reason="flat")
        return Decision(action=self.robot.zeros(), reason="holding")

    def _move(self, observation: Observation, dx: float, dz: float, reason: str) -> Decision:
        if self._phase in ("aside", "descend", "lay"):
            fresh = self._rng.normal(0.0, TREMOR_M * np.sqrt(1.0 - TREMOR_MEMORY**2), 2)
            self._tremor = TREMOR_MEMORY * self._tremor + fresh
            # Near the table a person's hand is steadied by what it touches.
            dx, dz = np.array([dx, dz]) + self._tremor * min(1.0, float(observation.holder_position[2]) / STEADY_M)
        moves = np.array([dx, 0.0, dz])
        if self.robot.n_points == 1:
            return Decision(action=self.robot.pack(moves), reason=reason)
        # Two points make the same move, and each drifts back to its own line, level with the other.
        centre = observation.holder_position
        home = centre + np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]) * self._held_width_m / 2
        home[:, 1] -= centre[1]
        align = np.clip(home - observation.corner_positions, -ALIGN_STEP_M, ALIGN_STEP_M)
        action = self.robot.pack(moves + align)
        return Decision(action=np.clip(action, -ACTION_LIMIT_M, ACTION_LIMIT_M), reason=reason)


def keep_taut(dx: float, dz: float, laid: float, height: float, taut: float) -> tuple[float, float]:
    """Return (dx, dz) m, further to the front where the held edge would come nearer to the free edge than ``taut``.

    ``laid`` and ``height`` lead from the free edge to the held one, along x and up, m. No step gets longer than
    LAY_STEP_M, and the descent never pauses.
    """
    low = max(height + dz, 0.0)
    ahead = float(np.sqrt(max(taut**2 - low**2, 0.0))) - laid
    if ahead <= dx:
        return dx, dz
    ahead = min(ahead, LAY_STEP_M)
    return ahead, -max(min(-dz, float(np.sqrt(LAY_STEP_M**2 - ahead**2))), LAND_STEP_M)
