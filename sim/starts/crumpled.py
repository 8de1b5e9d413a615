"""The cloth lies crumpled (chapter 3-2-2): hard-coded moves lay it and push wrinkles into it.

The moves look at the mesh, as a person who prepares an experiment looks at the cloth; what flattens it does not.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError
from layflat.sim.starts.base import Start, StartScene

DESCEND_STEP_M = 0.010
TRAIL_STEP_M = (0.012, 0.004)
"""Step forward and down while the free edge begins to touch: an edge that lands first folds under."""
TRAIL_M = 0.05
TOUCH_HEIGHT_M = 0.012
BRAKE_ABOVE_M = 0.06
LAY_STEP_M = 0.012
LAY_STEPS = 120
LAID_M = 0.005
REST_M = 0.004
"""Height of the pickers where they lie with the cloth."""
LAY_REACH = 0.95
"""Share of the cloth's length that is laid: taut enough to lie flat, with a little slack for a wrinkle."""
PUSH_WIDTH_M = 0.35
"""Width of the cloth for which the steps below are; a smaller cloth is pushed in proportion."""
BACK_STEP_M = (0.003, 0.0045)
INWARD_STEP_M = (0.003, 0.0045)
"""Displacement of each picker back and towards the other in one step of the push, drawn for each: the ratio gives its
wrinkles their direction. Pushed straight back the cloth rolls into one bulge along y or folds over at the corners.
With a wider range of both and up to 40 steps the corners got wrapped into the cloth, and 8 of 15 runs of Algorithm 2
(5 starts, steps of 3, 5 and 10 mm) then tore an edge beyond the stretch limit."""
PUSH_CONTACT = (0.77, 0.81)
"""Contact of the mesh at which the push ends, drawn; the cloth loses 0.02 more while it settles, and the camera then
sees 0.74, as in figure 3-6."""
PUSH_STEPS = 24
NARROWEST_MARGINS = 3.0
"""Distance of the pickers, in margins of the cloth for each cell of the hem between them, at which the push ends as
well: a hem that bunches up where its layers, two margins thick, have no room diverges (5 of 8 napkins)."""
SETTLE_STEPS = 8


def _crumple(scene: StartScene) -> Mapping[str, float]:
    """Lay the hanging cloth, push wrinkles in until the camera sees about 0.74 of it, let it settle."""
    cloth, rng, corners = scene.cloth, scene.rng, scene.robot.corner_positions
    spec = cloth.spec
    _lay(scene)
    scale = spec.width_m / PUSH_WIDTH_M
    back, inward = scale * rng.uniform(*BACK_STEP_M, 2), scale * rng.uniform(*INWARD_STEP_M, 2)
    until = float(rng.uniform(*PUSH_CONTACT))
    push = np.array([[-back[0], -inward[0], 0.0], [-back[1], inward[1], 0.0]]).ravel()
    n_steps = 0
    narrow = NARROWEST_MARGINS * spec.margin_m * (spec.columns - 1)
    while (
        n_steps < PUSH_STEPS and np.ptp(corners()[:, 1]) > narrow and cloth.contact_portion_true(cloth.nodes()) > until
    ):
        _move(scene, push)
        n_steps += 1
    for _ in range(SETTLE_STEPS):
        _move(scene, np.zeros(6))
    drawn = {"push_back_1_m": back[0], "push_back_2_m": back[1], "push_inward_1_m": inward[0]}
    drawn |= {"push_inward_2_m": inward[1], "push_steps": n_steps}
    nodes = cloth.nodes()
    result = {"contact_portion_true": cloth.contact_portion_true(nodes), "flat_area": cloth.flat_area(nodes)}
    return {name: float(value) for name, value in (drawn | result).items()}


def _lay(scene: StartScene) -> None:
    """Move down until the free edge trails behind on the table, then straight to where the held edge belongs."""
    cloth, corners, spec = scene.cloth, scene.robot.corner_positions, scene.cloth.spec
    for _ in range(LAY_STEPS):
        edge, x = cloth.nodes()[: spec.columns], float(corners()[:, 0].mean())
        lowest = float(edge[:, 2].min())
        if lowest <= TOUCH_HEIGHT_M and x - float(edge[:, 0].max()) >= TRAIL_M:
            break
        high = float(np.clip((lowest - TOUCH_HEIGHT_M) / BRAKE_ABOVE_M, 0.0, 1.0))
        dz = TRAIL_STEP_M[1] + high * (DESCEND_STEP_M - TRAIL_STEP_M[1])
        _move(scene, np.array([(1 - high) * TRAIL_STEP_M[0], 0.0, -dz] * 2))
    for _ in range(LAY_STEPS):
        centre = corners().mean(axis=0)
        if centre[2] <= LAID_M:
            break
        goal = float(cloth.nodes()[: spec.columns, 0].mean()) + LAY_REACH * spec.length_m
        to_go = np.array([max(goal - centre[0], 0.0), 0.0, REST_M - centre[2]])
        _move(scene, np.tile(to_go * min(1.0, LAY_STEP_M / float(np.linalg.norm(to_go))), 2))


def _move(scene: StartScene, action: FloatArray) -> None:
    scene.step(action)
    reason = scene.cloth.divergence_reason(scene.cloth.nodes())
    if reason is not None:
        raise SimError(f"the cloth diverged while it was crumpled ({reason}); take another seed")


CRUMPLED = Start(name="crumpled", move=_crumple, two_points=True)
