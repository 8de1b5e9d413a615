"""A gamepad as a source: a PS4's, or any that SDL, a calibration or a known raw layout can tell the buttons of.

Several pads: the first is used, and others are left alone while it is there. When it is gone, the next one that is
plugged in, or another one as soon as one of its buttons is pressed, takes its place.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.devices import Device, GamepadRegistry, pad_events
from layflat.app.workstation.teleop.gamepad_state import GamepadState, label
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

CONTROLS = {
    "cross": Command.START,
    "options": Command.PAUSE,
    "triangle": Command.KEEP_SUCCESS,
    "square": Command.KEEP_FAILURE,
    "circle": Command.DISCARD,
    "share": Command.REDO,
    "ps": Command.QUIT,
    "up": Command.DISTURB,
}
SPEED = 0.5
"""With both triggers let go: 10 mm a step, about what the scripted demonstrator does."""
FINE_SPEED = 0.1
"""With L2 pulled; R2 goes to 1."""


class Gamepad:
    """Sticks move, triggers make it faster or finer; see ``help``."""

    name = "gamepad"

    def __init__(
        self, robot: RobotSpec, *, mapping: Path | None = None, own_events: bool = True, left: int = 2
    ) -> None:
        """``own_events``: False where a window takes all events and passes them to ``on_event``.

        ``left``: the picker on the left as the person sees it; in the window's first view that is 2, at -y.
        """
        self.robot: RobotSpec = robot
        self._left = left
        self._own_events = own_events
        self._pygame, controller = sdl.start()
        self._events = pad_events(self._pygame)
        self._pads = GamepadRegistry(self._pygame, controller, mapping=mapping)
        self._used: Device | None = None
        self._lost = ""
        self._waiting: set[int] = set()
        """Instances that were there already when the pad in use went."""
        self._down: frozenset[str] = frozenset()
        self._presses: deque[tuple[int, Any]] = deque(maxlen=200)

    def on_event(self, event: Any) -> bool:
        """One of pygame's events; True if it is a pad's."""
        if event.type not in self._events:
            return False
        if hasattr(event, "instance_id"):
            self._presses.append((event.instance_id, event))
        return True

    def poll(self) -> TeleopInput:
        if self._own_events:
            for event in self._pygame.event.get(self._events):
                self.on_event(event)
        self._pads.refresh()
        self._choose()
        if self._used is None:
            self._presses.clear()
            return zero_input(self.robot, connected=False, problem=self._problem())
        state = self._used.state()
        controls = tuple(CONTROLS[button] for button in self._pressed(state) if button in CONTROLS)
        others = len(self._pads.devices) - 1
        return TeleopInput(
            motion=motion(self.robot, state, left=self._left),
            speed=speed(state),
            controls=controls,
            device=self._used.name + (f" ({others} more not used)" if others else ""),
        )

    def rumble(self, strength: float, seconds: float) -> None:
        if self._used is not None:
            self._used.rumble(strength, seconds)

    def help(self) -> tuple[Button, ...]:
        return (
            *_HELP[self.robot.n_points],
            *(Button(label(name), control.value, control) for name, control in CONTROLS.items()),
        )

    def close(self) -> None:
        self._pads.close()
        self._used = None

    def _choose(self) -> None:
        """Keep to the pad that is used; without one take the first, a new one, or one that speaks up."""
        devices = self._pads.devices
        if self._used is not None and self._used.instance not in devices:
            self._lost, self._used = self._used.name, None
            self._waiting = set(devices)
        if self._used is None:
            spoke = {instance for instance, event in self._presses if self._is_press(instance, event)}
            fresh = [i for i in devices if i not in self._waiting or i in spoke]
            self._use(devices[fresh[0]] if fresh else None)

    def _use(self, device: Device | None) -> None:
        self._used = device
        if device is not None:
            # What is held down already when a pad comes is not a press.
            self._down = device.state().pressed

    def _is_press(self, instance: int, event: Any) -> bool:
        device = self._pads.devices.get(instance)
        return device is not None and device.press(event) is not None

    def _pressed(self, state: GamepadState) -> list[str]:
        """Buttons that went down since the last poll: by their events, in order, and whatever no event told of."""
        pressed = []
        while self._presses:
            instance, event = self._presses.popleft()
            button = self._used.press(event) if self._used is not None and instance == self._used.instance else None
            if button is not None:
                pressed.append(button)
        pressed += sorted(state.pressed - self._down - set(pressed))
        self._down = state.pressed
        return pressed

    def _problem(self) -> str:
        if self._pads.unknown:
            return next(iter(self._pads.unknown.values()))
        if self._lost and self._pads.devices:
            return f"{self._lost} is gone; plug it in again, or press a button of {self._other()}"
        if self._lost:
            return f"{self._lost} is gone; plug it in again"
        return "no gamepad is plugged in; plug one in, or use --source keyboard"

    def _other(self) -> str:
        return next(iter(self._pads.devices.values())).name


def motion(robot: RobotSpec, state: GamepadState, *, left: int = 2) -> FloatArray:
    """(A,) in [-1, 1]: what the sticks ask for. To the right is +x, up is +z.

    Two pickers have a stick each. L1 held: to the side is y instead of x. R1 held: the left stick moves both pickers,
    the right one both across.
    """
    (left_x, left_y), (right_x, right_y) = state.left, state.right
    if robot.n_points == 1:
        return robot.pack([left_x, right_x, left_y])
    across = 1.0 if left == 2 else -1.0
    if "r1" in state.pressed:
        both = [left_x, across * right_x, left_y]
        return robot.pack(both)
    ways = [
        [0.0, across * x, y] if "l1" in state.pressed else [x, 0.0, y]
        for x, y in ((left_x, left_y), (right_x, right_y))
    ]
    return robot.pack(ways if left == 1 else ways[::-1])


def speed(state: GamepadState) -> float:
    """0..1: R2 pulls it up to 1, L2 down to FINE_SPEED."""
    return min(max(SPEED + (1.0 - SPEED) * state.r2 - (SPEED - FINE_SPEED) * state.l2, FINE_SPEED), 1.0)


_TRIGGERS = (Button("R2", "faster"), Button("L2", "finer"))
_HELP: dict[int, tuple[Button, ...]] = {
    1: (Button("left stick", "moves the hanger forth and back, up and down"), *_TRIGGERS),
    2: (
        Button("left, right stick", "moves the left, right picker forth and back, up and down"),
        Button("L1 held", "the sticks move to the side instead of forth and back"),
        Button("R1 held", "the left stick moves both pickers, the right one moves both to the side"),
        *_TRIGGERS,
    ),
}
