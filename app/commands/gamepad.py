"""`layflat gamepad monitor|calibrate`: show the inputs of a gamepad, and map them."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.calibration import Calibration, RawState
from layflat.app.workstation.teleop.devices import GamepadDevice, GamepadRegistry, gamepad_events
from layflat.app.workstation.teleop.gamepad import COMMANDS
from layflat.app.workstation.teleop.gamepad_state import STICKS, GamepadState, StickRest, label
from layflat.app.workstation.teleop.mapping import (
    DeviceCapabilities,
    mapping_file,
    read_mapping,
    write_mapping,
)

POLL_S = 0.02
LINE_S = 0.1
"""Shortest time between two lines where stdout is not a terminal."""
NO_GAMEPAD = "no gamepad is plugged in; plug one in, or record with --source keyboard"
SDL_STICKS = DeviceCapabilities(axes=len(STICKS), buttons=0, hats=0)
BAR = 21
"""Characters of a bar; odd, so that there is a middle."""


def monitor(mapping: Path | None, seconds: float | None) -> None:
    """Show the inputs of the first gamepad until Ctrl-C, until it is unplugged, or for so long."""
    if mapping is not None:
        validators.readable_file(mapping, "a gamepad mapping, by `layflat gamepad calibrate --file`")
    pygame, controller = sdl.start()
    gamepads = GamepadRegistry(pygame, controller, mapping=mapping)
    gamepads.refresh()
    with ExitStack() as stack:
        stack.callback(gamepads.close)
        instance, joystick = _first(pygame)
        device = gamepads.devices.get(instance)
        if device is None:
            print(f"layflat: {gamepads.unknown.get(instance, 'its buttons are not known')}", file=sys.stderr)
        show = _live_table(stack, joystick, device) if sys.stdout.isatty() else _lines(joystick, device)
        end = time.monotonic() + (seconds if seconds is not None else float("inf"))
        while time.monotonic() < end:
            pygame.event.get(gamepad_events(pygame))
            if instance not in _joysticks(pygame):
                raise LayflatError(f"{joystick.get_name()} was unplugged")
            show()
            time.sleep(POLL_S)


def calibrate(file: Path | None, force: bool, *, sticks: bool = False, dead_zone: float | None = None) -> None:
    """Ask for each stick and button of the first gamepad, and write a mapping.

    ``sticks`` only learns where its sticks rest; ``dead_zone`` alone is only stored. The rest of a mapping stays then.
    """
    pygame, controller = sdl.start()
    instance, joystick = _first(pygame)
    guid, name, capabilities = joystick.get_guid(), joystick.get_name(), DeviceCapabilities.of(joystick)
    path = file or mapping_file(guid)
    changes = sticks or dead_zone is not None
    validators.writable_file(path, force=force, append=changes, suffix=".json")
    mapping, rest = read_mapping(path, capabilities) if changes and path.exists() else (None, StickRest())
    print(f"{name}: {capabilities}", file=sys.stderr)
    read: Callable[[], RawState] = partial(RawState.of, joystick)
    inputs = capabilities
    with ExitStack() as stack:
        if sticks:
            gamepads = GamepadRegistry(pygame, controller, mapping=path if file and path.exists() else None)
            stack.callback(gamepads.close)
            gamepads.refresh()
            if instance not in gamepads.devices:
                raise LayflatError(gamepads.unknown.get(instance, f"{name} is not known; calibrate all of it"))
            device = gamepads.devices[instance]
            read, inputs = lambda: RawState(tuple(device.sticks().values()), frozenset()), SDL_STICKS
        if sticks or not changes:
            calibration = _converse(pygame, instance, name, read, inputs, only_sticks=sticks)
            mapping, rest = mapping if sticks else calibration.mapping(), calibration.rest()
    if dead_zone is not None:
        rest = replace(rest, dead_zone=dead_zone)
    write_mapping(path, mapping, guid=guid, name=name, capabilities=capabilities, rest=rest)
    print(f"  dead zone {rest.dead_zone:.2f} of a stick's way", file=sys.stderr)
    print(f"calibrated {name}: {path}")


def _converse(
    pygame: Any, instance: int, name: str, read: Callable[[], RawState], has: DeviceCapabilities, *, only_sticks: bool
) -> Calibration:
    """Return the finished calibration."""
    calibration = Calibration(
        has,
        lambda text: print(f"  {text}", file=sys.stderr, flush=True),
        time.monotonic,
        only_sticks=only_sticks,
    )
    while not calibration.done:
        pygame.event.get(gamepad_events(pygame))
        if instance not in _joysticks(pygame):
            raise LayflatError(f"{name} was unplugged; nothing was written")
        calibration.update(read())
        time.sleep(POLL_S)
    return calibration


def _first(pygame: Any) -> tuple[int, Any]:
    """Return instance and raw joystick of the first gamepad that is plugged in."""
    pygame.event.pump()
    joysticks = _joysticks(pygame)
    if not joysticks:
        raise LayflatError(NO_GAMEPAD)
    instance = min(joysticks)
    if len(joysticks) > 1:
        print(f"layflat: {len(joysticks)} gamepads are plugged in; the first one is used", file=sys.stderr)
    return instance, joysticks[instance]


def _joysticks(pygame: Any) -> dict[int, Any]:
    joysticks = [pygame.joystick.Joystick(index) for index in range(pygame.joystick.get_count())]
    return {int(joystick.get_instance_id()): joystick for joystick in joysticks}


def _title(joystick: Any, device: GamepadDevice | None) -> str:
    return f"{joystick.get_name()}: " + (f"known by {device.source}" if device else "its buttons are not known")


def _lines(joystick: Any, device: GamepadDevice | None) -> Callable[[], None]:
    """Return a function that prints one plain line for each change."""
    print(_title(joystick, device), flush=True)
    last, printed_s = "", -LINE_S

    def show() -> None:
        nonlocal last, printed_s
        line = _line(joystick, device)
        if line != last and time.monotonic() - printed_s >= LINE_S:
            last, printed_s = line, time.monotonic()
            print(line, flush=True)

    return show


def _line(joystick: Any, device: GamepadDevice | None) -> str:
    if device is None:
        raw = RawState.of(joystick)
        return f"axes {' '.join(f'{value:+.2f}' for value in raw.axes)} pressed {' '.join(sorted(raw.pressed)) or '-'}"
    state = device.state()
    numbers = " ".join(f"{name} {value:+.2f}" for name, value in _axes(state).items())
    return f"{numbers} pressed {' '.join(sorted(state.pressed)) or '-'}"


def _live_table(stack: ExitStack, joystick: Any, device: GamepadDevice | None) -> Callable[[], None]:
    """Return a function that redraws a table, until the stack is closed."""
    live = stack.enter_context(Live(console=Console(), auto_refresh=False))
    return lambda: live.update(_table(joystick, device), refresh=True)


def _table(joystick: Any, device: GamepadDevice | None) -> Table:
    table = Table("input", "value", "", "command", title=_title(joystick, device))
    if device is None:
        raw = RawState.of(joystick)
        for number, value in enumerate(raw.axes):
            table.add_row(f"axis {number}", f"{value:+.2f}", _bar(value), "")
        table.add_row("pressed", "", " ".join(sorted(raw.pressed)), "name them with `layflat gamepad calibrate`")
        return table
    state = device.state()
    for name, value in _axes(state).items():
        table.add_row(name, f"{value:+.2f}", _bar(value), "")
    for button, command in COMMANDS.items():
        table.add_row(label(button), "", "■" if button in state.pressed else "", command.value)
    others = sorted(label(button) for button in state.pressed if button not in COMMANDS)
    table.add_row("others", "", " ".join(others), "")
    return table


def _axes(state: GamepadState) -> dict[str, float]:
    return {
        "left x": state.left[0],
        "left y": state.left[1] + 0.0,  # Not -0.
        "right x": state.right[0],
        "right y": state.right[1] + 0.0,
        "L2": state.l2,
        "R2": state.r2,
    }


def _bar(value: float) -> str:
    """Return -1..1 as a mark on a line."""
    at = round((min(max(value, -1.0), 1.0) + 1.0) / 2.0 * (BAR - 1))
    return "".join("█" if k == at else "│" if k == BAR // 2 else "─" for k in range(BAR))
