"""Every robot by its name. A new one adds a file and an entry here."""

from __future__ import annotations

from layflat.data.robot import RobotSpec
from layflat.sim.errors import look_up
from layflat.sim.robots.base import Robot
from layflat.sim.robots.dual_arm import DualArm
from layflat.sim.robots.hanger import PandaHanger
from layflat.sim.robots.pickers import FreePickers

_TYPES: tuple[type[Robot], ...] = (PandaHanger, FreePickers, DualArm)
ROBOTS: dict[str, type[Robot]] = {robot.spec.name: robot for robot in _TYPES}
THESIS_ROBOTS = (PandaHanger.spec.name, FreePickers.spec.name)
"""The robots of the thesis, which its reproduction, the demo and the benchmark tables have."""
DEFAULT_ROBOT = PandaHanger.spec.name


def robot_type(name: str) -> type[Robot]:
    """Return the class of a robot; SimError lists the known names."""
    return look_up("robot", name, ROBOTS)


def robot_spec(name: str) -> RobotSpec:
    """Return the name and action axes of a robot; SimError lists the known names."""
    return robot_type(name).spec
