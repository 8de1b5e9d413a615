"""The keyboard in the window: keys come up there, too, so several may be held."""

from __future__ import annotations

from typing import Any

from layflat.app.workstation.teleop import key_map, sdl
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.data.robot import RobotSpec

_NAMED = ("left", "right", "up", "down")


class WindowKeyboard:
    """Hears of keys by ``on_event``; forgets those that are held when the window loses the focus."""

    name = "keyboard"

    def __init__(self, robot: RobotSpec, *, left: int = 2) -> None:
        self.robot: RobotSpec = robot
        self._pygame = sdl.load()
        self._moves = key_map.key_motions(robot, left=left)
        self._held: dict[int, str] = {}
        """Name at the time of the press by pygame's code: letting go of shift first must not leave a key held."""
        self._controls: list[Command] = []
        self._speed = key_map.SPEED

    def on_event(self, event: Any) -> bool:
        pygame = self._pygame
        if event.type == pygame.WINDOWFOCUSLOST:
            self._held.clear()
            return False
        if event.type == pygame.KEYUP:
            return self._held.pop(event.key, None) is not None
        if event.type != pygame.KEYDOWN or event.mod & (pygame.KMOD_CTRL | pygame.KMOD_ALT | pygame.KMOD_META):
            return False
        name = self._name(event)
        if name in key_map.CONTROLS:
            self._controls.append(key_map.CONTROLS[name])
        elif name in key_map.SPEEDS:
            self._speed = key_map.SPEEDS[name]
        elif name in self._moves:
            self._held[event.key] = name
        else:
            return False
        return True

    def poll(self) -> TeleopInput:
        controls, self._controls = tuple(self._controls), []
        motion = key_map.sum_motions(self.robot, self._moves, self._held.values())
        return TeleopInput(motion=motion, speed=self._speed, controls=controls, device="keyboard")

    def rumble(self, strength: float, seconds: float) -> None:
        """Keyboards do not."""

    def help(self) -> tuple[Button, ...]:
        return key_map.help_of(self.robot)

    def close(self) -> None:
        self._held.clear()

    def _name(self, event: Any) -> str:
        """As the terminal has it."""
        pygame = self._pygame
        if event.key in (pygame.K_RETURN, pygame.K_KP_ENTER):
            return "enter"
        name = str(pygame.key.name(event.key))
        shift = bool(event.mod & pygame.KMOD_SHIFT)
        if name in _NAMED:
            return f"shift-{name}" if shift else name
        return name.upper() if shift and len(name) == 1 else name
