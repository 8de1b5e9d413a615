"""Gamepads: a PS4's, or any whose buttons SDL, a calibration or a known raw layout can name.

The first of several gamepads is used. When it is disconnected, the next one that is plugged in takes its place, or
another one as soon as one of its buttons is pressed.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.devices import GamepadDevice, GamepadRegistry, gamepad_events
from layflat.app.workstation.teleop.gamepad_state import GamepadState, label
from layflat.app.workstation.teleop.keyboard import LEFT, RIGHT
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.app.workstation.teleop.teleoperator import Button, WindowTeleoperator
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

COMMANDS = {
    "cross": Command.START,
    "options": Command.PAUSE,
    "triangle": Command.KEEP_SUCCESS,
    "square": Command.KEEP_FAILURE,
    "circle": Command.DISCARD,
    "share": Command.REDO,
    "ps": Command.QUIT,
    "up": Command.DISTURB,
    "down": Command.UNDO,
}
SPEED = 0.5
"""Speed with both triggers released: 10 mm a step, about that of the scripted demonstrator."""
FINE_SPEED = 0.1
"""Speed with L2 pulled; R2 goes up to 1."""


class Gamepad(WindowTeleoperator):
    """Teleoperator whose sticks move the robot and whose triggers make that faster or finer."""

    name = "gamepad"

    def __init__(self, robot: RobotSpec, *, mapping: Path | None = None, own_events: bool = True) -> None:
        """Open the gamepads; ``own_events`` is False where a window takes all events and passes them to `on_event`."""
        self.robot: RobotSpec = robot
        self._own_events = own_events
        self._pygame, controller = sdl.start()
        self._event_types = gamepad_events(self._pygame)
        self._gamepads = GamepadRegistry(self._pygame, controller, mapping=mapping)
        self._used: GamepadDevice | None = None
        self._lost_name = ""
        self._waiting: set[int] = set()
        """Instances that were there already when the gamepad in use was disconnected."""
        self._down: frozenset[str] = frozenset()
        self._presses: deque[tuple[int, Any]] = deque(maxlen=200)

    def on_event(self, event: Any) -> bool:
        """Handle one of pygame's events; return whether it is a gamepad's."""
        if event.type not in self._event_types:
            return False
        if hasattr(event, "instance_id"):
            self._presses.append((event.instance_id, event))
        return True

    def poll(self) -> TeleopInput:
        """Return the state of the gamepad in use, or that there is none."""
        if self._own_events:
            for event in self._pygame.event.get(self._event_types):
                self.on_event(event)
        self._gamepads.refresh()
        self._choose()
        if self._used is None:
            self._presses.clear()
            return zero_input(self.robot, connected=False, problem=self._problem())
        state = self._used.state()
        n_others = len(self._gamepads.devices) - 1
        return TeleopInput(
            motion=motion(self.robot, state),
            speed=speed(state),
            commands=tuple(COMMANDS[button] for button in self._pressed(state) if button in COMMANDS),
            device=self._used.name + (f" ({n_others} more not used)" if n_others else ""),
        )

    def rumble(self, strength: float, seconds: float) -> None:
        """Rumble the gamepad in use."""
        if self._used is not None:
            self._used.rumble(strength, seconds)

    def help(self) -> tuple[Button, ...]:
        """Return the effect of sticks, triggers and buttons."""
        commands = (Button(label(name), command.value, command) for name, command in COMMANDS.items())
        return (*_MOTION_HELP[self.robot.n_points], *commands)

    def close(self) -> None:
        """Release all gamepads."""
        self._gamepads.close()
        self._used = None

    def _choose(self) -> None:
        """Keep the gamepad in use; without one take the first, a new one, or one of which a button is pressed."""
        devices = self._gamepads.devices
        if self._used is not None and self._used.instance not in devices:
            self._lost_name, self._used = self._used.name, None
            self._waiting = set(devices)
        if self._used is None:
            pressed = {instance for instance, event in self._presses if self._is_press(instance, event)}
            candidates = [i for i in devices if i not in self._waiting or i in pressed]
            if candidates:
                self._used = devices[candidates[0]]
                # A button that is held already when a gamepad comes is not a press.
                self._down = self._used.state().pressed

    def _is_press(self, instance: int, event: Any) -> bool:
        device = self._gamepads.devices.get(instance)
        return device is not None and device.pressed_button(event) is not None

    def _pressed(self, state: GamepadState) -> list[str]:
        """Return the buttons pressed since the last poll: by their events, in order, then those without an event."""
        pressed = []
        while self._presses:
            instance, event = self._presses.popleft()
            used = self._used is not None and instance == self._used.instance
            button = self._used.pressed_button(event) if self._used is not None and used else None
            if button is not None:
                pressed.append(button)
        pressed += sorted(state.pressed - self._down - set(pressed))
        self._down = state.pressed
        return pressed

    def _problem(self) -> str:
        if self._gamepads.unknown:
            return next(iter(self._gamepads.unknown.values()))
        if self._lost_name:
            other = next((f", or press a button of {device.name}" for device in self._gamepads.devices.values()), "")
            return f"{self._lost_name} was disconnected; plug it in again{other}"
        return "no gamepad is plugged in; plug one in, or use the keyboard"


def motion(robot: RobotSpec, state: GamepadState) -> FloatArray:
    """Return the motion (A,) in [-1, 1] that the sticks ask for: to the right is +x, up is +z.

    Two points have a stick each. L1 held: to the side is y instead of x. R1 held: the left stick moves both points,
    the right one both to the side.
    """
    (left_x, left_y), (right_x, _) = state.left, state.right
    if robot.n_points == 1 or "r1" in state.pressed:
        return robot.pack([left_x, right_x, left_y])
    pair = np.zeros((2, 3))
    for point, (x, y) in ((LEFT, state.left), (RIGHT, state.right)):
        pair[point] = [0.0, x, y] if "l1" in state.pressed else [x, 0.0, y]
    return robot.pack(pair)


def speed(state: GamepadState) -> float:
    """Return the share of the full speed: R2 raises it to 1, L2 lowers it to FINE_SPEED."""
    return min(max(SPEED + (1.0 - SPEED) * state.r2 - (SPEED - FINE_SPEED) * state.l2, FINE_SPEED), 1.0)


_TRIGGERS = (Button("R2, L2", "faster, finer"),)
_MOTION_HELP: dict[int, tuple[Button, ...]] = {
    1: (Button("left stick", "hanger: forward, back, up, down"), *_TRIGGERS),
    2: (
        Button("left, right stick", "left, right picker: forward, back, up, down"),
        Button("L1 held", "to the side"),
        Button("R1 held", "left stick: both; right: both to the side"),
        *_TRIGGERS,
    ),
}
