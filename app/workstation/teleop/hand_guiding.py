"""Hand guiding in the window: the mouse grabs the robot and guides it, as the thesis's hand guides the compliant arm.

Chapter 3-3 of the thesis.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from layflat.app.workstation.teleop.mouse import DragTeleoperator, Pixel
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

GRAB_M = 0.06
"""Distance from the line of sight within which a press grabs something."""
STEEP = 0.2
"""Smallest component of the line of sight across the plane of motion that still says where in the plane the hand is."""
Ray: TypeAlias = Callable[[Pixel], tuple[FloatArray, FloatArray]]
"""Origin (3,) m and direction (3,), world, of the line of sight behind a pixel of the window."""


class HandGuidingTeleoperator(DragTeleoperator):
    """Teleoperator that returns `TeleopInput.hand` while something is held, in the robot's hand shape."""

    name = "kinesthetic"

    def __init__(self, robot: RobotSpec, ray: Ray, corners: Callable[[], FloatArray]) -> None:
        """Use ``corners``, which returns the newest places (2, 3) m of the two held corners."""
        super().__init__(robot)
        self._ray = ray
        self._corners = corners
        self._grab: Grab | None = None

    def press(self, at: Pixel) -> bool:
        """Grab what is behind a pixel; return whether there is anything."""
        self._grab = grab(self.robot, self._corners(), *self._ray(at))
        return self._grab is not None

    def move(self, at: Pixel) -> None:
        """Guide what is held to a pixel."""
        if self._grab is not None:
            self._grab.guide(*self._ray(at))

    def poll(self) -> TeleopInput:
        """Return the hand, and the keys' commands."""
        keys = self.keyboard.poll()
        hand = self._grab.hand if self.dragging and self._grab is not None else None
        motion = self.robot.zeros()
        return TeleopInput(motion=motion, speed=keys.speed, commands=keys.commands, device="mouse", hand=hand)

    def help(self) -> tuple[Button, ...]:
        """Return the effect of drags and keys."""
        what = "the hanger" if self.robot.n_points == 1 else "a picker"
        return (Button(f"drag {what}", "guides it by hand"), *(b for b in self.keyboard.help() if b.command))


class Grab:
    """Something held: the hand follows the mouse in a plane through the place where it was grabbed."""

    def __init__(self, robot: RobotSpec, places: FloatArray, which: int, at: FloatArray, normal: FloatArray) -> None:
        """Hold point ``which`` of ``places``, (P, 3) m, at the place ``at``, (3,) m, with the plane's ``normal``."""
        self._robot = robot
        self._places = places
        self._which = which
        self._at = at
        self._normal = normal
        self.hand = places.reshape(robot.hand_shape)

    def guide(self, origin: FloatArray, direction: FloatArray) -> None:
        """Move the hand to a line of sight; one that misses the plane leaves the hand where it is."""
        across = float(direction @ self._normal)
        if abs(across) < 1e-6:
            return
        distance = float((self._at - origin) @ self._normal) / across
        if distance <= 0:
            return
        places = self._places.copy()
        # Only along the axes that the point can move: the hanger's arm moves in x and z.
        can_move = [any(a.point == self._which and a.axis == axis for a in self._robot.axes) for axis in range(3)]
        places[self._which] += (origin + distance * direction - self._at) * can_move
        self.hand = places.reshape(self._robot.hand_shape)


def grab(robot: RobotSpec, corners: FloatArray, origin: FloatArray, direction: FloatArray) -> Grab | None:
    """Return what a press on this line of sight grabs; None where nothing is close, or the corners are unknown."""
    if not np.isfinite(corners).all():
        return None
    direction = direction / np.linalg.norm(direction)
    whole = robot.n_points == 1
    bar = corners[0] + np.linspace(0.0, 1.0, 41)[:, None] * (corners[1] - corners[0])
    at, distance_m = _nearest(bar if whole else corners, origin, direction)
    if distance_m > GRAB_M:
        return None
    if whole:
        return Grab(robot, corners.mean(axis=0, keepdims=True), 0, at, _motion_plane(direction))
    which = int(np.linalg.norm(corners - at, axis=1).argmin())
    return Grab(robot, corners.copy(), which, at, _facing_plane(direction))


def _motion_plane(direction: FloatArray) -> FloatArray:
    """Return the normal of the hanger's plane of motion, or, seen edge on, of the plane that faces the eye."""
    return np.array([0.0, 1.0, 0.0]) if abs(direction[1]) > STEEP else direction


def _facing_plane(direction: FloatArray) -> FloatArray:
    """Return the normal of the upright plane that faces the eye; seen from above, of the horizontal plane."""
    level = np.array([direction[0], direction[1], 0.0])
    length = np.linalg.norm(level)
    return level / length if length > STEEP else np.array([0.0, 0.0, 1.0])


def _nearest(points: FloatArray, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, float]:
    """Return the point of (N, 3) that is nearest to the line, and its distance."""
    along = np.maximum((points - origin) @ direction, 0.0)
    gaps = np.linalg.norm(points - origin - along[:, None] * direction, axis=1)
    return points[int(gaps.argmin())], float(gaps.min())
