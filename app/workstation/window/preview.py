"""The bench before anything runs: the chosen cloth hanging where an episode will begin."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import robot_type
from layflat.sim.starts.base import home_corners


@lru_cache(maxsize=4)
def preview(robot: str, cloth: str) -> BenchFrame:
    """What one would see, without a simulator."""
    settings = SimConfig(robot=robot, cloth=cloth)
    home = home_corners(settings.cloth_spec)
    centre = home.mean(axis=0)
    return BenchFrame(
        episode=-1,
        step=0,
        phase="place",
        sim_s=0.0,
        told_s=0.0,
        input_s=0.0,
        work_s=0.0,
        robot=robot,
        cloth=cloth,
        nodes=settings.cloth_spec.hanging_nodes(home),
        corners=home,
        holder=centre,
        joints=robot_type(robot).joint_angles_at(centre),
        hands=np.zeros((0, 3)),
        force_n=np.zeros(3),
        pull=None,
        word=np.zeros(2),
        strength=0.0,
        contact=0.0,
        contact_true=0.0,
        flat_area=0.0,
        rgb=None,
        cloth_state=None,
    )
