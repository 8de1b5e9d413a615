"""Values that the tests of several packages share."""

from __future__ import annotations

from layflat.sim.robots.registry import ROBOTS, robot_spec

HANGER = robot_spec("hanger")
PICKERS = robot_spec("pickers")
ROBOT_SPECS = tuple(robot_spec(name) for name in ROBOTS)
