"""The mouse in the window as a joystick: how far it has been dragged from where it was pressed is how fast to move."""

from __future__ import annotations

from typing import Any

import numpy as np

from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.gamepad_state import dead_zone
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.app.workstation.teleop.window_keyboard import WindowKeyboard
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

REACH_PX = 150.0
"""Dragged so far, it moves at the whole speed."""
DEAD = 0.05
"""Share of that which counts as none."""
LEFT_BUTTON = 1


class Mouse:
    """Drag with the left button; the keys do the rest, and may move, too."""

    name = "mouse"

    def __init__(self, robot: RobotSpec, *, left: int = 2) -> None:
        self.robot: RobotSpec = robot
        self._pygame = sdl.load()
        self._keys = WindowKeyboard(robot, left=left)
        self._left = left
        self._from: tuple[int, int] | None = None
        self._at = (0, 0)

    def on_event(self, event: Any) -> bool:
        pygame = self._pygame
        if event.type == pygame.MOUSEBUTTONDOWN and event.button == LEFT_BUTTON:
            self._from = self._at = event.pos
            return True
        if event.type == pygame.MOUSEBUTTONUP and event.button == LEFT_BUTTON:
            dragged, self._from = self._from is not None, None
            return dragged
        if event.type == pygame.MOUSEMOTION and self._from is not None:
            self._at = event.pos
            return True
        if event.type == pygame.WINDOWFOCUSLOST:
            self._from = None
        return self._keys.on_event(event)

    def poll(self) -> TeleopInput:
        keys = self._keys.poll()
        motion = np.clip(keys.motion + self._dragged(), -1.0, 1.0)
        return TeleopInput(motion=motion, speed=keys.speed, controls=keys.controls, device="mouse")

    def rumble(self, strength: float, seconds: float) -> None:
        """Mice do not."""

    def help(self) -> tuple[Button, ...]:
        return (
            *_HELP[self.robot.n_points],
            *(button for button in self._keys.help() if button.control or "speed" in button.does),
        )

    def close(self) -> None:
        self._from = None
        self._keys.close()

    def _dragged(self) -> FloatArray:
        """(A,) of the drag: to the right is +x, up is +z."""
        if self._from is None:
            return self.robot.zeros()
        right, up = (self._at[0] - self._from[0]) / REACH_PX, (self._from[1] - self._at[1]) / REACH_PX
        right, up = dead_zone(right, up, dead=DEAD)
        if self.robot.n_points == 1:
            return self.robot.pack([right, 0.0, up])
        held = self._pygame.key.get_mods()
        across = 1.0 if self._left == 2 else -1.0
        way = [0.0, across * right, up] if held & self._pygame.KMOD_SHIFT else [right, 0.0, up]
        pair = np.array([way, way])
        if held & self._pygame.KMOD_CTRL:
            pair[2 - self._left] = 0.0
        elif held & self._pygame.KMOD_ALT:
            pair[self._left - 1] = 0.0
        return self.robot.pack(pair)


_HELP: dict[int, tuple[Button, ...]] = {
    1: (Button("drag", "moves the hanger: the farther, the faster"),),
    2: (
        Button("drag", "moves both pickers: the farther, the faster; with shift to the side"),
        Button("Ctrl, Alt drag", "moves only the left, only the right one"),
    ),
}
