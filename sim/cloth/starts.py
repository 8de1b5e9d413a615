"""Where an episode begins: how the cloth is hung up or laid, and what the holder does before anyone decides."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.cloth import HELD_STRETCH, Cloth, ClothSpec
from layflat.sim.cloth.crumple import crumple
from layflat.sim.disturbances.presets import DisturbanceSpec, DisturbanceTrajectory, disturbance_spec
from layflat.sim.physics.bullet.air_drag import AirDrag
from layflat.sim.robots.base import Robot
from layflat.sim.robots.pickers import FreePickers

Start: TypeAlias = Literal["hanging", "crumpled", "folded-corner", "swinging"]
STARTS: tuple[Start, ...] = ("hanging", "crumpled", "folded-corner", "swinging")

START_CLEARANCE_M = 0.12
"""The free edge hangs this high above the table before the random moves."""
START_MOVES = 20
LAID_FREE_EDGE_M = (-0.04, 0.14)
"""Where the free edge lies after a demonstration."""
LAID_HEIGHT_M = 0.0065
"""Of the held hem after a demonstration."""
LAID_STRETCH = 1.01
"""How far the holder draws a laid cloth taut."""
CLIPPING_S = 0.25
"""In which a cloth's corners are drawn from where they are at rest to where the holder takes them."""
FOLD = "fold-corner"
"""The hand that turns the corner over, a disturbance."""
FOLD_STEPS = 35
"""The hand's two seconds at most, and one in which the corner settles."""
CALM_STEPS = 3
"""What was put down comes to rest."""

SWING_STEP_M = (0.016, 0.020)
"""Forth and back in one step, drawn: 0.2 m/s is what nobody should move a hanging cloth with."""
SWING_STEPS = (5, 4)
"""Forth for half the cloth's period, then back: it swings to the front while its holder goes the other way."""
SWING_CLEARANCE_M = (0.0, 0.012)
"""How high above the table the free edge would be in the end if the cloth hung straight, drawn. From 0.02 m upwards it
swings back before it touches, and ends flat."""


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """A cloth that is to be put into a world."""

    corners: FloatArray
    """(2, 3) m: where the holder begins."""
    nodes: FloatArray
    """(N, 3) m: the cloth without tension, near there."""
    about: Mapping[str, float]
    """What was drawn, for the episode's record."""


def home_corners(spec: ClothSpec) -> FloatArray:
    """(2, 3) m: the corners before the random moves; the free edge hangs over x = 0."""
    return _corners(spec, 0.0, spec.length_m + START_CLEARANCE_M)


def sample_initial_state(start: Start, spec: ClothSpec, rng: np.random.Generator) -> InitialState:
    """Where the holder and the cloth are when the world is made."""
    if start == "folded-corner":
        return _laid(spec, rng)
    corners = home_corners(spec)
    slack = corners / np.array([1.0, HELD_STRETCH, 1.0])
    return InitialState(corners=corners, nodes=spec.hanging_nodes(slack), about={})


def attach(cloth: Cloth, corners: FloatArray, air: AirDrag) -> None:
    """Fingers draw the cloth's two held corners to ``corners`` (2, 3) m, where the holder takes them.

    A cloth begins at rest, which is narrower than the holder: nodes that are set wider would be its shape at rest.
    """
    world = cloth.world
    at = cloth.nodes()[list(cloth.spec.corners)]
    fingers = FreePickers(cloth, at)
    fingers.grip()
    substeps = world.halves(CLIPPING_S) // 2
    fingers.start_step((corners - at).ravel(), substeps)
    for _ in range(substeps):
        air.before_substep()
        fingers.before_substep()
        world.step()
    fingers.release()


def run_start_motion(
    start: Start,
    cloth: Cloth,
    holder: Robot,
    step: Callable[[FloatArray], None],
    disturb: Callable[[DisturbanceSpec], DisturbanceTrajectory],
    rng: np.random.Generator,
) -> Mapping[str, float]:
    """What happens before anyone decides; ``step`` is one control step, ``disturb`` begins what acts in the next ones.

    Returns what was drawn.
    """
    if start == "crumpled":
        return crumple(cloth, holder.corner_positions, step, rng)
    size = holder.spec.size
    if start == "folded-corner":
        return _fold(lambda: step(np.zeros(size)), disturb)
    for _ in range(START_MOVES):
        step(rng.uniform(-1.0, 1.0, size) * holder.start_step_m)
    return _swing(cloth, holder, step, rng) if start == "swinging" else {}


def _corners(spec: ClothSpec, x_m: float, z_m: float) -> FloatArray:
    half = HELD_STRETCH * spec.width_m / 2
    return np.array([[x_m, half, z_m], [x_m, -half, z_m]])


def _laid(spec: ClothSpec, rng: np.random.Generator) -> InitialState:
    """Laid and dragged taut."""
    x = rng.uniform(*LAID_FREE_EDGE_M)
    return InitialState(
        corners=_corners(spec, x + LAID_STRETCH * spec.length_m, LAID_HEIGHT_M), nodes=spec.flat_nodes(x_m=x), about={}
    )


def _fold(rest: Callable[[], None], disturb: Callable[[DisturbanceSpec], DisturbanceTrajectory]) -> Mapping[str, float]:
    """A hand turns one corner of the free edge over (figure 5-2).

    Nodes that are put where a fold has them will not do: Bullet takes what it is given for the cloth's shape at rest,
    and the crease stays for ever.
    """
    for _ in range(CALM_STEPS):
        rest()
    plan = disturb(disturbance_spec(FOLD))
    for _ in range(FOLD_STEPS):
        rest()
    reach = plan.path_m[-1]
    return {
        "fold_along_m": float(reach[0]),
        "fold_across_m": float(abs(reach[1])),
        "fold_side": -float(np.sign(reach[1])),
    }


def _swing(
    cloth: Cloth, holder: Robot, step: Callable[[FloatArray], None], rng: np.random.Generator
) -> Mapping[str, float]:
    """Forth, back and down too fast: the free edge swings ahead and is about to touch first (figure 5-1)."""
    speed, clearance = rng.uniform(*SWING_STEP_M), rng.uniform(*SWING_CLEARANCE_M)
    down = float(holder.position()[2]) - cloth.spec.length_m - clearance
    forth, back = SWING_STEPS
    for k in range(forth + back):
        move = np.array([speed if k < forth else -speed, 0.0, -down / (forth + back)])
        step(holder.spec.pack(move))
    return {"swing_step_m": float(speed), "swing_clearance_m": float(clearance)}
