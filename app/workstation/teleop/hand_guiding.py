"""HandGuidingTeleoperator teaching in the window: the mouse takes hold of what holds the cloth and leads it, as the
thesis's hand
leads the robot's arm, which gives way (chapter 3-3)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.app.workstation.teleop.window_keyboard import WindowKeyboard
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

GRASP_M = 0.06
"""A press takes hold of what is this close to the line of sight."""
LEFT_BUTTON = 1
STEEP = 0.2
"""A line of sight with less of its direction across the plane of motion says too little of where in it the hand is."""
Ray: TypeAlias = Callable[[tuple[int, int]], tuple[FloatArray, FloatArray]]
"""Origin (3,) m and direction (3,), world, of the line of sight behind a pixel of the window."""


class HandGuidingTeleoperator:
    """Gives ``TeleopInput.hand`` while something is held: for the hanger (3,), its centre; for two pickers (2, 3)."""

    name = "kinesthetic"

    def __init__(self, robot: RobotSpec, ray: Ray, corners: Callable[[], FloatArray]) -> None:
        """``corners`` gives the newest (2, 3) m of where the two held corners are."""
        self.robot: RobotSpec = robot
        self._pygame = sdl.load()
        self._keys = WindowKeyboard(robot)
        self._ray = ray
        self._corners = corners
        self._hold: Grab | None = None

    def on_event(self, event: Any) -> bool:
        pygame = self._pygame
        if event.type == pygame.MOUSEBUTTONDOWN and event.button == LEFT_BUTTON:
            self._hold = take_hold(self.robot, self._corners(), *self._ray(event.pos))
            return self._hold is not None
        if event.type == pygame.MOUSEBUTTONUP and event.button == LEFT_BUTTON:
            held, self._hold = self._hold is not None, None
            return held
        if event.type == pygame.MOUSEMOTION and self._hold is not None:
            self._hold.lead(*self._ray(event.pos))
            return True
        if event.type == pygame.WINDOWFOCUSLOST:
            self._hold = None
        return self._keys.on_event(event)

    def poll(self) -> TeleopInput:
        keys = self._keys.poll()
        hand = None if self._hold is None else self._hold.hand
        rest = self.robot.zeros()
        return TeleopInput(motion=rest, speed=keys.speed, controls=keys.controls, device="mouse", hand=hand)

    def rumble(self, strength: float, seconds: float) -> None:
        """Mice do not."""

    def help(self) -> tuple[Button, ...]:
        what = "the hanger" if self.robot.n_points == 1 else "a picker"
        return (Button(f"drag {what}", "leads it by hand"), *(b for b in self._keys.help() if b.control))

    def close(self) -> None:
        self._hold = None
        self._keys.close()


class Grab:
    """Something taken hold of: the hand follows the mouse in a plane through the place of the grasp."""

    def __init__(self, places: FloatArray, which: int | None, at: FloatArray, normal: FloatArray) -> None:
        """``places`` (3,) or (2, 3) m; ``which`` of two is held; ``at`` (3,) m: where; ``normal`` of the plane."""
        self.hand = places
        self._places = places
        self._which = which
        self._at = at
        self._normal = normal

    def lead(self, origin: FloatArray, direction: FloatArray) -> None:
        """The mouse is on this line of sight now; one that misses the plane leaves the hand where it is."""
        across = float(direction @ self._normal)
        if abs(across) < 1e-6:
            return
        far = float((self._at - origin) @ self._normal) / across
        if far <= 0:
            return
        moved = origin + far * direction - self._at
        hand = self._places.copy()
        if self._which is None:
            hand += [moved[0], 0.0, moved[2]]  # The hanger's arm moves in x and z.
        else:
            hand[self._which] += moved
        self.hand = hand


def take_hold(robot: RobotSpec, corners: FloatArray, origin: FloatArray, direction: FloatArray) -> Grab | None:
    """What a press on this line of sight takes hold of; None where nothing is close, or nothing is known of it yet."""
    if not np.isfinite(corners).all():
        return None
    direction = direction / np.linalg.norm(direction)
    if robot.n_points == 1:
        along = np.linspace(0.0, 1.0, 41)[:, None]
        bar = corners[0] + along * (corners[1] - corners[0])
        at, gap = _nearest(bar, origin, direction)
        return Grab(corners.mean(axis=0), None, at, _plane(direction)) if gap <= GRASP_M else None
    at, gap = _nearest(corners, origin, direction)
    if gap > GRASP_M:
        return None
    which = int(np.linalg.norm(corners - at, axis=1).argmin())
    # A picker is free: it follows in the upright plane that faces the eye.
    level = np.array([direction[0], direction[1], 0.0])
    facing = level / np.linalg.norm(level) if np.linalg.norm(level) > STEEP else np.array([0.0, 0.0, 1.0])
    return Grab(corners.copy(), which, at, facing)


def _plane(direction: FloatArray) -> FloatArray:
    """Normal of the plane in which the hanger is led: of its motion, or, seen edge on, the one that faces the eye."""
    return np.array([0.0, 1.0, 0.0]) if abs(direction[1]) > STEEP else direction


def _nearest(points: FloatArray, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, float]:
    """Of (N, 3) the one nearest to the line, and how far it is from it."""
    along = np.maximum((points - origin) @ direction, 0.0)
    gaps = np.linalg.norm(points - origin - along[:, None] * direction, axis=1)
    return points[int(gaps.argmin())], float(gaps.min())
