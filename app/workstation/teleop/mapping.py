"""Mappings of pads that a person has calibrated: one JSON file for each kind of pad."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import platformdirs

from layflat.app.support.errors import UsageError
from layflat.app.workstation.teleop.layouts import Binding, DeviceCapabilities, GamepadLayout, TriggerAxis
from layflat.data.atomic_files import atomic_path

SCHEMA = 1
LARGEST_BYTES = 100_000


def mapping_file(guid: str) -> Path:
    """Where the mapping of a kind of pad is kept, in the user's folder for configuration."""
    return Path(platformdirs.user_config_dir("layflat")) / "pads" / f"{re.sub('[^0-9a-zA-Z]', '', guid)}.json"


def saved_mapping(guid: str, counts: DeviceCapabilities) -> GamepadLayout | None:
    """What the user has calibrated for this kind of pad, checked; None where nothing is there."""
    path = mapping_file(guid)
    return read_mapping(path, counts) if path.is_file() else None


def write_mapping(path: Path, layout: GamepadLayout, *, guid: str, pad: str, counts: DeviceCapabilities) -> None:
    """Write a checked layout, whole or not at all."""
    layout.check(counts)
    text = {
        "schema": SCHEMA,
        "pad": pad,
        "guid": guid,
        "axes": counts.axes,
        "buttons": counts.buttons,
        "hats": counts.hats,
        "sticks": {name: {"axis": axis, "sign": sign} for name, (axis, sign) in layout.sticks.items()},
        "triggers": {name: _trigger_text(way) for name, way in layout.triggers.items()},
        "pressed": {name: way.text for name, way in layout.buttons.items()},
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as part:
        part.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")


def read_mapping(path: Path, counts: DeviceCapabilities) -> GamepadLayout:
    """The layout in a file, or UsageError: not one of ours, damaged, or of a pad with other counts."""
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise UsageError(f"{path} is too large for the mapping of a pad")
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or content.get("schema") != SCHEMA:
            raise UsageError(
                f"{path} is no mapping of a pad in version {SCHEMA}; `layflat gamepad calibrate` writes one"
            )
        had = DeviceCapabilities(content["axes"], content["buttons"], content["hats"])
        if had != counts:
            raise UsageError(
                f"{path} is for a pad with {_said(had)}, and this one has {_said(counts)}; calibrate this one"
            )
        return _layout(content).check(counts)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}") from error
    except (UnicodeDecodeError, json.JSONDecodeError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(f"{path} is no mapping of a pad ({error}); `layflat gamepad calibrate` writes one") from error


def _layout(content: dict[str, Any]) -> GamepadLayout:
    return GamepadLayout(
        name="calibrated",
        sticks={name: (_index(way["axis"]), _direction(way["sign"])) for name, way in content["sticks"].items()},
        triggers={name: _trigger(way) for name, way in content["triggers"].items()},
        buttons={name: Binding(text) for name, text in content["pressed"].items()},
    )


def _trigger(way: Any) -> TriggerAxis | Binding:
    if isinstance(way, str):
        return Binding(way)
    rest, full = float(way["rest"]), float(way["full"])
    if not (-1 <= rest <= 1 and -1 <= full <= 1 and abs(full - rest) > 0.1):
        raise ValueError(f"a trigger from {rest} to {full}")
    return TriggerAxis(_index(way["axis"]), rest, full)


def _trigger_text(way: TriggerAxis | Binding) -> str | dict[str, float]:
    return way.text if isinstance(way, Binding) else {"axis": way.axis, "rest": way.rest, "full": way.full}


def _index(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"an axis called {value!r}")
    return value


def _direction(value: Any) -> int:
    if value not in (1, -1):
        raise ValueError(f"a sign of {value!r}")
    return int(value)


def _said(counts: DeviceCapabilities) -> str:
    return f"{counts.axes} axes, {counts.buttons} buttons and {counts.hats} hats"
