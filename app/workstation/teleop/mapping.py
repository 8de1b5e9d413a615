"""Mappings of gamepads that SDL does not know, in SDL's words: known layouts, and those that a person has calibrated.

A mapping gives each stick, trigger and button its place: ``b3`` a button, ``h0.1`` a direction of a hat (1 up, 2 right,
4 down, 8 left), ``a5`` an axis, ``a5~`` a reversed one, ``+a5`` and ``-a5`` its halves. Calibrated ones are JSON files.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import platformdirs

from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, DEAD_ZONE, STICKS, TRIGGERS, StickRest
from layflat.data.atomic_files import atomic_path

PadMapping: TypeAlias = Mapping[str, str]
"""Place of each of STICKS, TRIGGERS and BUTTONS."""
SCHEMA = 2
LARGEST_BYTES = 100_000
REQUIRED = (*STICKS, "cross", "circle", "square", "triangle", "share", "options", "l1", "r1")
"""Inputs that a recording with two points needs."""
_SDL = (
    *("a", "b", "x", "y", "back", "guide", "start", "leftstick", "rightstick", "leftshoulder", "rightshoulder"),
    *("dpup", "dpdown", "dpleft", "dpright", "leftx", "lefty", "rightx", "righty", "lefttrigger", "righttrigger"),
)
SDL_NAMES = dict(zip((*BUTTONS, *STICKS, *TRIGGERS), _SDL, strict=True))
_PLACE = re.compile(r"(?:(b)(\d{1,3})|(h)(\d)\.[1248]|[+-]?(a)(\d{1,2})~?)")


class RawGamepadState(Protocol):
    """Raw inputs, as of pygame.joystick.Joystick."""

    def get_numaxes(self) -> int: ...
    def get_numbuttons(self) -> int: ...
    def get_numhats(self) -> int: ...
    def get_axis(self, axis_number: int, /) -> float: ...
    def get_button(self, button: int, /) -> bool: ...
    def get_hat(self, hat_number: int, /) -> tuple[int, int]: ...


@dataclass(frozen=True)
class DeviceCapabilities:
    """Numbers of inputs, by which raw layouts differ."""

    axes: int
    buttons: int
    hats: int

    @classmethod
    def of(cls, gamepad: RawGamepadState) -> DeviceCapabilities:
        """Count the inputs of a gamepad."""
        return cls(gamepad.get_numaxes(), gamepad.get_numbuttons(), gamepad.get_numhats())

    def __str__(self) -> str:
        return f"{self.axes} axes, {self.buttons} buttons and {self.hats} hats"

    def has(self, place: object) -> bool:
        """Return whether such a gamepad has a place; UsageError where it is none."""
        found = _PLACE.fullmatch(place) if isinstance(place, str) else None
        if found is None:
            raise UsageError(f"{place!r} is no input of a gamepad; write b3, h0.1, a5, a5~, +a5 or -a5")
        kind, number = filter(None, found.groups())
        return int(number) < {"a": self.axes, "b": self.buttons, "h": self.hats}[kind]


def check_mapping(mapping: PadMapping, capabilities: DeviceCapabilities) -> PadMapping:
    """Return the mapping, or raise UsageError: complete, nothing twice, only inputs that the gamepad has."""
    unknown, missing = sorted(set(mapping) - set(SDL_NAMES)), [name for name in REQUIRED if name not in mapping]
    if unknown:
        raise UsageError(f"the mapping has inputs named {', '.join(unknown)}; known are {', '.join(SDL_NAMES)}")
    if missing:
        raise UsageError(f"the mapping lacks {', '.join(missing)}; calibrate the gamepad again")
    taken: dict[str, str] = {}
    for name, place in mapping.items():
        if not capabilities.has(place) or (name in STICKS and place[0] != "a"):
            raise UsageError(f"the mapping has {name} at {place}, which the gamepad lacks; calibrate it again")
        other = taken.setdefault(place.rstrip("~"), name)
        if other != name:
            raise UsageError(f"the mapping has {other} and {name} both at {place}; calibrate it again")
    return mapping


def sdl_text(guid: str, mapping: PadMapping) -> str:
    """Return a mapping as SDL reads it; ``*`` keeps the gamepad's own name."""
    return ",".join([guid, "*", *(f"{SDL_NAMES[name]}:{place}" for name, place in mapping.items()), ""])


def _layout(axes: str, buttons: str, *, hat: bool) -> PadMapping:
    found = {name: f"{kind}{k}" for kind, row in (("a", axes), ("b", buttons)) for k, name in enumerate(row.split())}
    hats = {"up": "h0.1", "down": "h0.4", "left": "h0.8", "right": "h0.2"} if hat else {}
    return {name: place for name, place in (found | hats).items() if name in SDL_NAMES}


_C_AXES = "left_x left_y right_x l2 r2 right_y"
_C_BUTTONS = "square cross circle triangle l1 r1 - - share options l3 r3 ps"
RAW_LAYOUTS: Mapping[str, PadMapping] = {
    "A": _layout(" ".join((*STICKS, *TRIGGERS)), " ".join(BUTTONS), hat=False),
    "B": _layout(
        "left_x left_y l2 right_x right_y r2",
        "cross circle triangle square l1 r1 - - share options ps l3 r3",
        hat=True,
    ),
    "C": _layout(_C_AXES, _C_BUTTONS, hat=True),
    "C without a hat": _layout(_C_AXES, _C_BUTTONS, hat=False),
}
"""Layouts of PS4 gamepads; B is that of the Linux kernel's own driver, C that under Linux without it."""


def raw_layout(gamepad: RawGamepadState) -> str | None:
    """Return the name of the layout of an unmapped PS4 gamepad, by its numbers of inputs; None for any other one."""
    has = DeviceCapabilities.of(gamepad)
    if has == DeviceCapabilities(6, 16, 0):
        return "A"
    # The generic driver may count the touchpad's click, too, and may have no hat.
    if has in (DeviceCapabilities(6, 14, 0), DeviceCapabilities(6, 13, 0)):
        return "C without a hat"
    if has == DeviceCapabilities(6, 14, 1):
        return "C"
    # The numbers fit B and C. Triggers rest at -1 and sticks at 0, which tells them apart.
    resting = {axis for axis in range(has.axes) if gamepad.get_axis(axis) < -0.99}
    return ("C" if resting == {3, 4} else "B") if has == DeviceCapabilities(6, 13, 1) else None


def mapping_file(guid: str) -> Path:
    """Return the file for a kind of gamepad, in the user's folder for configuration."""
    return Path(platformdirs.user_config_dir("layflat")) / "pads" / f"{re.sub('[^0-9a-zA-Z]', '', guid)}.json"


def write_mapping(
    path: Path,
    mapping: PadMapping | None,
    *,
    guid: str,
    name: str,
    capabilities: DeviceCapabilities,
    rest: StickRest | None = None,
) -> None:
    """Check a mapping, or None where SDL knows it, and write it atomically with the places where the sticks rest."""
    content: dict[str, Any] = {"schema": SCHEMA, "pad": name, "guid": guid} | asdict(capabilities)
    content |= asdict(rest or StickRest())
    if mapping is not None:
        content["inputs"] = dict(check_mapping(mapping, capabilities))
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read_mapping(path: Path, capabilities: DeviceCapabilities) -> tuple[PadMapping | None, StickRest]:
    """Return what a file says of a gamepad; UsageError where it is foreign, damaged or for one with other inputs."""
    try:
        content = json.loads(validators.read_text(path, "the mapping of a gamepad", max_bytes=LARGEST_BYTES))
        if not isinstance(content, dict) or content.get("schema") != SCHEMA:
            raise ValueError(f"it has no schema {SCHEMA}")
        mapped = DeviceCapabilities(content["axes"], content["buttons"], content["hats"])
        if mapped != capabilities:
            raise UsageError(
                f"{path} is for a gamepad with {mapped}, and this one has {capabilities}; calibrate this one"
            )
        rest = StickRest(
            dead_zone=float(content.get("dead_zone", DEAD_ZONE)),
            middle={name: float(value) for name, value in content.get("middle", {}).items()},
        )
        if "inputs" not in content and "dead_zone" in content:
            return None, rest
        return check_mapping(dict(content["inputs"]), capabilities), rest
    except (json.JSONDecodeError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(
            f"{path} is not a gamepad mapping ({error}); write one with `layflat gamepad calibrate`"
        ) from error
