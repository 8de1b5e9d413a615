"""The mouse in the window: dragged as a joystick, or guiding the robot as the thesis's hand guides the compliant arm.

Chapter 3-3 of the thesis for the second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.gamepad_state import dead_zone
from layflat.app.workstation.teleop.keyboard import LEFT, RIGHT, WindowKeyboard
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, WindowTeleoperator
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

REACH_PX = 150.0
"""Length of a drag that moves at full speed."""
DEAD = 0.05
"""Share of it that counts as none."""
GRAB_M = 0.06
"""Distance from the line of sight within which a press grabs something."""
STEEP = 0.2
"""Smallest component of the line of sight across the plane of motion that still says where in the plane the hand is."""
LEFT_BUTTON = 1
Pixel: TypeAlias = tuple[int, int]
Ray: TypeAlias = Callable[[Pixel], tuple[FloatArray, FloatArray]]
"""Origin (3,) m and direction (3,), world, of the line of sight behind a pixel of the window."""


class DragTeleoperator(WindowTeleoperator):
    """Base of what a drag with the left button does, beside a keyboard for everything else."""

    def __init__(self, robot: RobotSpec) -> None:
        self.robot: RobotSpec = robot
        self.keyboard = WindowKeyboard(robot)
        self.release_taps = self.keyboard.release_taps  # type: ignore[method-assign]
        self.dragging = False
        self._pygame = sdl.load()

    def press(self, at: Pixel) -> bool:
        """Start a drag at a pixel of the window; return whether there is something to drag."""
        raise NotImplementedError

    def move(self, at: Pixel) -> None:
        """Continue the drag."""
        raise NotImplementedError

    def on_event(self, event: Any) -> bool:
        """Handle the left mouse button, and keys."""
        pygame = self._pygame
        if event.type == pygame.MOUSEBUTTONDOWN and event.button == LEFT_BUTTON:
            self.dragging = self.press(event.pos)
            return self.dragging
        if event.type == pygame.MOUSEBUTTONUP and event.button == LEFT_BUTTON:
            dragged, self.dragging = self.dragging, False
            return dragged
        if event.type == pygame.MOUSEMOTION and self.dragging:
            self.move(event.pos)
            return True
        self.dragging = self.dragging and event.type != pygame.WINDOWFOCUSLOST
        return self.keyboard.on_event(event)

    def close(self) -> None:
        """End the drag and release all keys."""
        self.dragging = False
        self.keyboard.close()


class Mouse(DragTeleoperator):
    """Teleoperator that is dragged as a joystick is pushed: the farther, the faster; keys may move the robot, too."""

    name = "mouse"

    def __init__(self, robot: RobotSpec, scale: Callable[[], float] = lambda: 1.0) -> None:
        """Use ``scale``, which returns that of the display: lengths of drags are px at scale 1."""
        super().__init__(robot)
        self._scale = scale
        self._start: Pixel = (0, 0)
        self._at: Pixel = (0, 0)

    def press(self, at: Pixel) -> bool:
        """Start a drag; it may start anywhere."""
        self._start = self._at = at
        return True

    def move(self, at: Pixel) -> None:
        """Continue the drag."""
        self._at = at

    def band(self) -> tuple[Pixel, Pixel, float] | None:
        """Return where the drag began and where it is, and the length of one at full speed, px; None without one."""
        return (self._start, self._at, REACH_PX * self._scale()) if self.dragging else None

    def poll(self) -> TeleopInput:
        """Return the motion of the drag and the keys, and the keys' commands."""
        keys = self.keyboard.poll()
        motion = np.clip(keys.motion + self._drag_motion(), -1.0, 1.0)
        return TeleopInput(motion=motion, speed=keys.speed, commands=keys.commands, device="mouse")

    def help(self) -> tuple[Button, ...]:
        """Return the effect of drags and keys."""
        keys = (button for button in self.keyboard.help() if button.command or "speed" in button.text)
        return (*_HELP[self.robot.n_points], *keys)

    def _drag_motion(self) -> FloatArray:
        """Return the motion (A,) of the drag: to the right is +x, up is +z."""
        if not self.dragging:
            return self.robot.zeros()
        reach = REACH_PX * self._scale()
        right, up = (self._at[0] - self._start[0]) / reach, (self._start[1] - self._at[1]) / reach
        right, up = dead_zone(right, up, dead=DEAD)
        if self.robot.n_points == 1:
            return self.robot.pack([right, 0.0, up])
        held = self._pygame.key.get_mods()
        pair = np.array([[0.0, right, up] if held & self._pygame.KMOD_SHIFT else [right, 0.0, up]] * 2)
        if held & self._pygame.KMOD_CTRL:
            pair[RIGHT] = 0.0
        elif held & self._pygame.KMOD_ALT:
            pair[LEFT] = 0.0
        return self.robot.pack(pair)


_HELP: dict[int, tuple[Button, ...]] = {
    1: (Button("drag", "moves the hanger: the farther, the faster"),),
    2: (
        Button("drag", "moves both pickers: the farther, the faster; with shift to the side"),
        Button("Ctrl, Alt drag", "moves only the left, only the right one"),
    ),
}


class HandGuidingTeleoperator(DragTeleoperator):
    """Teleoperator that returns `TeleopInput.hand` while something is held, in the robot's hand shape."""

    name = "kinesthetic"

    def __init__(self, robot: RobotSpec, ray: Ray, corners: Callable[[], FloatArray]) -> None:
        """Use ``corners``, which returns the newest places (2, 3) m of the two held corners."""
        super().__init__(robot)
        self._ray, self._corners = ray, corners
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
        self._robot, self._places, self._which, self._at, self._normal = robot, places, which, at, normal
        self.hand = places.reshape(robot.hand_shape)

    def guide(self, origin: FloatArray, direction: FloatArray) -> None:
        """Move the hand to a line of sight; one that misses the plane leaves the hand where it is."""
        across = float(direction @ self._normal)
        distance = float((self._at - origin) @ self._normal) / across if abs(across) >= 1e-6 else 0.0
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
    points = corners[0] + np.linspace(0.0, 1.0, 41)[:, None] * (corners[1] - corners[0]) if whole else corners
    along = np.maximum((points - origin) @ direction, 0.0)
    gaps = np.linalg.norm(points - origin - along[:, None] * direction, axis=1)
    at = points[int(gaps.argmin())]
    if gaps.min() > GRAB_M:
        return None
    if whole:
        # The hanger's plane of motion, or, seen edge on, the plane that faces the eye.
        normal = np.array([0.0, 1.0, 0.0]) if abs(direction[1]) > STEEP else direction
        return Grab(robot, corners.mean(axis=0, keepdims=True), 0, at, normal)
    # The upright plane that faces the eye; seen from above, the horizontal plane.
    level = direction * [1.0, 1.0, 0.0]
    length = np.linalg.norm(level)
    normal = level / length if length > STEEP else np.array([0.0, 0.0, 1.0])
    return Grab(robot, corners.copy(), int(np.linalg.norm(corners - at, axis=1).argmin()), at, normal)
