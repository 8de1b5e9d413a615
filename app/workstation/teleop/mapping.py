"""Mappings of gamepads that a person has calibrated: one JSON file for each kind of gamepad."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import platformdirs

from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.workstation.teleop.gamepad_state import DEAD_ZONE, StickRest
from layflat.app.workstation.teleop.layouts import Binding, DeviceCapabilities, GamepadLayout, TriggerAxis
from layflat.data.atomic_files import atomic_path

SCHEMA = 1
LARGEST_BYTES = 100_000


def mapping_file(guid: str) -> Path:
    """Return the file for a kind of gamepad, in the user's folder for configuration."""
    return Path(platformdirs.user_config_dir("layflat")) / "pads" / f"{re.sub('[^0-9a-zA-Z]', '', guid)}.json"


def write_mapping(
    path: Path,
    layout: GamepadLayout | None,
    *,
    guid: str,
    name: str,
    capabilities: DeviceCapabilities,
    rest: StickRest | None = None,
) -> None:
    """Check a layout, or None where SDL knows it, and write it atomically with the places where the sticks rest."""
    rest = rest or StickRest()
    text = {
        "schema": SCHEMA,
        "pad": name,
        "guid": guid,
        "axes": capabilities.axes,
        "buttons": capabilities.buttons,
        "hats": capabilities.hats,
        "dead_zone": rest.dead_zone,
        "middle": dict(rest.middle),
    }
    if layout is not None:
        layout.check(capabilities)
        text |= {
            "sticks": {name: {"axis": axis, "sign": sign} for name, (axis, sign) in layout.sticks.items()},
            "triggers": {name: _trigger_json(trigger) for name, trigger in layout.triggers.items()},
            "pressed": {name: binding.text for name, binding in layout.buttons.items()},
        }
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as part:
        part.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")


def read_mapping(path: Path, capabilities: DeviceCapabilities) -> GamepadLayout | None:
    """Return the layout in a file, or None where it only has the places where the sticks rest."""
    return read_settings(path, capabilities)[0]


def read_settings(path: Path, capabilities: DeviceCapabilities) -> tuple[GamepadLayout | None, StickRest]:
    """Return what a file says of a gamepad; UsageError where it is foreign, damaged or for one with other inputs."""
    try:
        content = json.loads(validators.read_text(path, "the mapping of a gamepad", max_bytes=LARGEST_BYTES))
        if not isinstance(content, dict) or content.get("schema") != SCHEMA:
            raise UsageError(
                f"{path} is not a gamepad mapping with schema {SCHEMA}; write one with `layflat gamepad calibrate`"
            )
        mapped = DeviceCapabilities(content["axes"], content["buttons"], content["hats"])
        if mapped != capabilities:
            raise UsageError(
                f"{path} is for a gamepad with {mapped}, and this one has {capabilities}; calibrate this one"
            )
        rest = StickRest(
            dead_zone=float(content.get("dead_zone", DEAD_ZONE)),
            middle={name: float(value) for name, value in content.get("middle", {}).items()},
        )
        if "sticks" not in content and "dead_zone" in content:
            return None, rest
        return _layout(content).check(capabilities), rest
    except (json.JSONDecodeError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(
            f"{path} is not a gamepad mapping ({error}); write one with `layflat gamepad calibrate`"
        ) from error


def _layout(content: dict[str, Any]) -> GamepadLayout:
    return GamepadLayout(
        name="calibrated",
        sticks={name: (_index(stick["axis"]), _sign(stick["sign"])) for name, stick in content["sticks"].items()},
        triggers={name: _trigger(trigger) for name, trigger in content["triggers"].items()},
        buttons={name: Binding(text) for name, text in content["pressed"].items()},
    )


def _trigger(trigger: Any) -> TriggerAxis | Binding:
    if isinstance(trigger, str):
        return Binding(trigger)
    rest, full = float(trigger["rest"]), float(trigger["full"])
    if not (-1 <= rest <= 1 and -1 <= full <= 1 and abs(full - rest) > 0.1):
        raise ValueError(f"a trigger goes from {rest} to {full}")
    return TriggerAxis(_index(trigger["axis"]), rest, full)


def _trigger_json(trigger: TriggerAxis | Binding) -> str | dict[str, float]:
    return trigger.text if isinstance(trigger, Binding) else asdict(trigger)


def _index(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"an axis is {value!r}")
    return value


def _sign(value: Any) -> int:
    if value not in (1, -1):
        raise ValueError(f"a sign is {value!r}")
    return int(value)
