"""A hanger that holds nothing, and its control steps."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots import panda
from layflat.sim.robots.hanger import PandaHanger

START = (0.0, 0.45)
Push = tuple[float, float, float]


def bare_hanger(
    world: BulletWorld, start: tuple[float, float] = START, cloth: str = "towel", **options: str
) -> PandaHanger:
    """Make a hanger without a cloth, which costs microseconds a substep."""
    spec = cloth_spec(cloth)
    return PandaHanger(SimpleNamespace(world=world, spec=spec), spec.corners_at(*start), **options)  # type: ignore[arg-type]


def run_step(
    world: BulletWorld, hanger: PandaHanger, action: tuple[float, float] = (0.0, 0.0), push_n: Push = (0.0, 0.0, 0.0)
) -> FloatArray:
    """Simulate a control step of 0.1 s; return the largest torque of each joint, (7,) N m."""
    substeps = round(0.1 / world.substep_s)
    hanger.start_step(np.array(action), substeps)
    return _substeps(world, hanger, substeps, push_n)


def guided_step(
    world: BulletWorld,
    hanger: PandaHanger,
    hand: FloatArray | None = None,
    push_n: Push = (0.0, 0.0, 0.0),
    load_n: float = 0.0,
) -> None:
    """Simulate a control step of 0.1 s in which a hand guides the hanger."""
    substeps = round(0.1 / world.substep_s)
    hanger.start_guided_step(hand, substeps, load_n)
    _substeps(world, hanger, substeps, push_n)


def _substeps(world: BulletWorld, hanger: PandaHanger, count: int, push_n: Push) -> FloatArray:
    largest = np.zeros(panda.JOINTS)
    for _ in range(count):
        hanger.before_substep()
        largest = np.maximum(largest, np.abs(hanger.joint_torques()))
        if any(push_n):
            hanger.arm.push_tool(np.array(push_n, dtype=float), hanger.position())
        world.step()
    return largest
