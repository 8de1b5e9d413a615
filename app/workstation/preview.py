"""Frame before anything runs: the chosen cloth, hanging where an episode will start."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.data.arrays import FloatArray
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import robot_type
from layflat.sim.starts.base import home_corners


@lru_cache(maxsize=4)
def initial_frame(robot: str, cloth: str) -> SimulationFrame:
    """Return what an episode starts with, without a simulator."""
    spec = cloth_spec(cloth)
    home = home_corners(spec)
    centre = home.mean(axis=0)
    return SimulationFrame(
        episode=-1,
        step=0,
        phase="place",
        sim_s=0.0,
        robot=robot,
        cloth=cloth,
        nodes=spec.hanging_nodes(home),
        corners=home,
        holder=centre,
        joints=arm_joints(robot, centre, spec),
    )


def arm_joints(robot: str, holder_m: FloatArray, cloth: ClothSpec) -> FloatArray:
    """Return the joint angles (J,) of the arm with its hand straight down; empty where there is no arm."""
    try:
        return robot_type(robot).joint_angles_at(holder_m, cloth)
    except SimError:
        return np.zeros(0)  # A place that no arm reaches was imported from elsewhere.
