"""`layflat gamepad monitor|calibrate`: what a pad says, and telling Layflat where it has its buttons."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.calibration import Calibration, RawState
from layflat.app.workstation.teleop.devices import Device, GamepadRegistry, pad_events
from layflat.app.workstation.teleop.gamepad import CONTROLS
from layflat.app.workstation.teleop.gamepad_state import GamepadState, label
from layflat.app.workstation.teleop.layouts import DeviceCapabilities
from layflat.app.workstation.teleop.mapping import mapping_file, write_mapping

LOOK_S = 0.02
LINE_S = 0.1
"""Without a terminal a line is printed when something has changed, at most so often."""
NO_PAD = "no gamepad is plugged in; plug one in, or record with --source keyboard"
BAR = 21
"""Characters; odd, so that there is a middle."""


def monitor(mapping: Path | None, seconds: float | None) -> None:
    """Show what the first pad says until Ctrl-C, until it is unplugged, or for so long."""
    if mapping is not None:
        validators.readable_file(mapping, "a pad's mapping, by `layflat gamepad calibrate --file`")
    pygame, controller = sdl.start()
    pads = GamepadRegistry(pygame, controller, mapping=mapping)
    pads.refresh()
    with ExitStack() as stack:
        stack.callback(pads.close)
        instance, joystick = _first(pygame)
        device = pads.devices.get(instance)
        if device is None:
            print(f"layflat: {pads.unknown.get(instance, 'its buttons are not known')}", file=sys.stderr)
        show = _live(stack, joystick, device) if sys.stdout.isatty() else _lines(joystick, device)
        end = time.monotonic() + (seconds if seconds is not None else float("inf"))
        while time.monotonic() < end:
            pygame.event.get(pad_events(pygame))
            if instance not in _instances(pygame):
                raise LayflatError(f"{joystick.get_name()} has been unplugged")
            show()
            time.sleep(LOOK_S)


def calibrate(file: Path | None, force: bool) -> None:
    """Ask for each stick and button of the first pad, and write where they are."""
    pygame, _ = sdl.start()
    instance, joystick = _first(pygame)
    guid, name, counts = joystick.get_guid(), joystick.get_name(), DeviceCapabilities.of(joystick)
    path = file or mapping_file(guid)
    if path.suffix != ".json":
        raise UsageError(f"{path} is no .json file; mappings are written as .json")
    validators.writable_file(path, force=force)
    print(f"{name}: {counts.axes} axes, {counts.buttons} buttons, {counts.hats} hats", file=sys.stderr)
    calibration = Calibration(counts, lambda text: print(f"  {text}", file=sys.stderr, flush=True), time.monotonic)
    while not calibration.done:
        pygame.event.get(pad_events(pygame))
        if instance not in _instances(pygame):
            raise LayflatError(f"{name} has been unplugged; nothing was written")
        calibration.see(joystick)
        time.sleep(LOOK_S)
    write_mapping(path, calibration.layout(), guid=guid, pad=name, counts=counts)
    print(f"calibrated {name}: {path}")


def _first(pygame: Any) -> tuple[int, Any]:
    """Instance and raw joystick of the first pad that is plugged in."""
    pygame.event.pump()
    instances = _instances(pygame)
    if not instances:
        raise LayflatError(NO_PAD)
    instance = min(instances)
    if len(instances) > 1:
        print(f"layflat: {len(instances)} pads are plugged in; this is about the first", file=sys.stderr)
    return instance, instances[instance]


def _instances(pygame: Any) -> dict[int, Any]:
    joysticks = [pygame.joystick.Joystick(index) for index in range(pygame.joystick.get_count())]
    return {int(joystick.get_instance_id()): joystick for joystick in joysticks}


def _lines(joystick: Any, device: Device | None) -> Callable[[], None]:
    """One plain line for each change."""
    how = "its buttons are not known" if device is None else f"known by {device.how}"
    print(f"{joystick.get_name()}: {how}", flush=True)
    last, spoke_s = "", -LINE_S

    def show() -> None:
        nonlocal last, spoke_s
        line = _line(joystick, device)
        if line != last and time.monotonic() - spoke_s >= LINE_S:
            last, spoke_s = line, time.monotonic()
            print(line, flush=True)

    return show


def _line(joystick: Any, device: Device | None) -> str:
    if device is None:
        raw = RawState.of(joystick)
        return f"axes {' '.join(f'{value:+.2f}' for value in raw.axes)} pressed {' '.join(sorted(raw.pressed)) or '-'}"
    state = device.state()
    numbers = " ".join(f"{name} {value:+.2f}" for name, value in _axes_of(state).items())
    return f"{numbers} pressed {' '.join(sorted(state.pressed)) or '-'}"


def _live(stack: ExitStack, joystick: Any, device: Device | None) -> Callable[[], None]:
    """A table that is drawn over and over, until the stack is left."""
    live = stack.enter_context(Live(console=Console(), auto_refresh=False))

    def show() -> None:
        live.update(_table(joystick, device), refresh=True)

    return show


def _table(joystick: Any, device: Device | None) -> Table:
    title = f"{joystick.get_name()}, " + (f"known by {device.how}" if device is not None else "unknown")
    table = Table("input", "value", "", "does", title=title)
    if device is None:
        raw = RawState.of(joystick)
        for number, value in enumerate(raw.axes):
            table.add_row(f"axis {number}", f"{value:+.2f}", _bar(value), "")
        table.add_row("pressed", "", " ".join(sorted(raw.pressed)), "`layflat gamepad calibrate` names them")
        return table
    state = device.state()
    for name, value in _axes_of(state).items():
        table.add_row(name, f"{value:+.2f}", _bar(value), "")
    for button, control in CONTROLS.items():
        table.add_row(label(button), "", "■" if button in state.pressed else "", control.value)
    others = sorted(label(button) for button in state.pressed if button not in CONTROLS)
    table.add_row("others", "", " ".join(others), "")
    return table


def _axes_of(state: GamepadState) -> dict[str, float]:
    return {
        "left x": state.left[0],
        "left y": state.left[1] + 0.0,  # Not -0.
        "right x": state.right[0],
        "right y": state.right[1] + 0.0,
        "L2": state.l2,
        "R2": state.r2,
    }


def _bar(value: float) -> str:
    """-1..1 as a mark on a line."""
    at = round((min(max(value, -1.0), 1.0) + 1.0) / 2.0 * (BAR - 1))
    return "".join("█" if k == at else "│" if k == BAR // 2 else "─" for k in range(BAR))
