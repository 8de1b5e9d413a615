"""The mouse in the window as a joystick: the farther it is dragged from where it was pressed, the faster the motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.gamepad_state import dead_zone
from layflat.app.workstation.teleop.key_map import LEFT, RIGHT
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, WindowTeleoperator
from layflat.app.workstation.teleop.window_keyboard import WindowKeyboard
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

REACH_PX = 150.0
"""Length of a drag that moves at full speed."""
DEAD = 0.05
"""Share of it that counts as none."""
LEFT_BUTTON = 1

Pixel = tuple[int, int]


class DragTeleoperator(WindowTeleoperator):
    """Base of what a drag with the left button does, beside a keyboard for everything else."""

    def __init__(self, robot: RobotSpec) -> None:
        self.robot: RobotSpec = robot
        self.keyboard = WindowKeyboard(robot)
        self.dragging = False
        self._pygame = sdl.load()

    def press(self, at: Pixel) -> bool:
        """Start a drag at a pixel of the window; return whether there is something to drag."""
        raise NotImplementedError

    def move(self, at: Pixel) -> None:
        """Continue the drag."""
        raise NotImplementedError

    def release_taps(self, acted_s: float) -> None:
        """Forget the taps of keys on which a step has acted, see `WindowKeyboard`."""
        self.keyboard.release_taps(acted_s)

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
        if event.type == pygame.WINDOWFOCUSLOST:
            self.dragging = False
        return self.keyboard.on_event(event)

    def close(self) -> None:
        """End the drag and release all keys."""
        self.dragging = False
        self.keyboard.close()


class Mouse(DragTeleoperator):
    """Teleoperator that is dragged as a joystick is pushed; keys may move the robot, too."""

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
