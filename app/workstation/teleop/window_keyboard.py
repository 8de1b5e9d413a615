"""Keyboard in the window, where several keys may be held together."""

from __future__ import annotations

import time
from typing import Any

from layflat.app.workstation.teleop import key_map, sdl
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, WindowTeleoperator
from layflat.data.robot import RobotSpec

TAP_S = 1.0
"""Time in which a key that is up again acts on a step; one that comes while nothing steps must not act later."""
_ARROWS = ("left", "right", "up", "down")


class WindowKeyboard(WindowTeleoperator):
    """Teleoperator of key events; held keys are released when the window loses the focus."""

    name = "keyboard"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot: RobotSpec = robot
        self._pygame = sdl.load()
        self._motions = key_map.key_motions(robot)
        self._held: dict[int, str] = {}
        """Name of each held key when it was pressed, by pygame's code: releasing shift first must not leave it held."""
        self._taps: dict[str, float] = {}
        """When each motion key was pressed that no step has acted on yet, s of the monotonic clock."""
        self._commands: list[Command] = []
        self._speed = key_map.SPEED

    def on_event(self, event: Any) -> bool:
        """Handle key presses and releases; leave shortcuts with Ctrl, Alt and Meta to the window."""
        pygame = self._pygame
        if event.type == pygame.WINDOWFOCUSLOST:
            self._held.clear()
            self._taps.clear()
            return False
        if event.type == pygame.KEYUP:
            return self._held.pop(event.key, None) is not None
        if event.type != pygame.KEYDOWN or event.mod & (pygame.KMOD_CTRL | pygame.KMOD_ALT | pygame.KMOD_META):
            return False
        name = self._key_name(event)
        if name in key_map.COMMANDS:
            self._commands.append(key_map.COMMANDS[name])
        elif name in key_map.SPEEDS:
            self._speed = key_map.SPEEDS[name]
        elif name in self._motions:
            self._held[event.key] = name
            self._taps[name] = time.monotonic()
        else:
            return False
        return True

    def poll(self) -> TeleopInput:
        """Return the motion of the held keys and the commands since the last poll."""
        commands, self._commands = tuple(self._commands), []
        now = time.monotonic()
        self._taps = {name: at_s for name, at_s in self._taps.items() if now - at_s < TAP_S}
        motion = key_map.sum_motions(self.robot, self._motions, {*self._held.values(), *self._taps})
        return TeleopInput(motion=motion, speed=self._speed, commands=commands, device="keyboard")

    def release_taps(self, acted_s: float) -> None:
        """Forget the taps before the input of ``acted_s``, on which a step has acted: each tap acts for a step."""
        self._taps = {name: at_s for name, at_s in self._taps.items() if at_s >= acted_s}

    def help(self) -> tuple[Button, ...]:
        """Return the effect of each key."""
        return key_map.key_help(self.robot)

    def close(self) -> None:
        """Release all keys."""
        self._held.clear()
        self._taps.clear()

    def _key_name(self, event: Any) -> str:
        """Return the name that the terminal uses for this key."""
        pygame = self._pygame
        if event.key in (pygame.K_RETURN, pygame.K_KP_ENTER):
            return "enter"
        name = str(pygame.key.name(event.key))
        shift = bool(event.mod & pygame.KMOD_SHIFT)
        if name in _ARROWS:
            return f"shift-{name}" if shift else name
        return name.upper() if shift and len(name) == 1 else name
