"""Conditions: every setting of a simulation that ``--set KEY=VALUE`` takes, in one table.

A new key is a field of `Conditions` and the place that reads it. Command line, `layflat config`, documentation,
sessions and variations follow from its metadata.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any, TypeAlias, cast, get_args

from layflat.data.types import STEP_S
from layflat.sim.cloth.spec import HELD_STRETCH, ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.robots.base import STIFFNESS_N_M, Control

Setting: TypeAlias = "str | int | float"
LIGHT_AZIMUTH_DEG, LIGHT_HEIGHT_DEG = 45.0, 39.12
"""Direction of `layflat.sim.camera.renderer.LIGHT`."""
CAMERA_WIDTH_PX = 320


@dataclass(frozen=True, kw_only=True)
class Key:
    """Type, unit, limits and meaning of a setting."""

    name: str
    default: Setting
    about: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    varies: bool = True
    """Whether a variation may draw it: not what all episodes of a session share."""

    @property
    def kind(self) -> type:
        """The type of the values."""
        return type(self.default)

    @property
    def wanted(self) -> str:
        """The values that are taken, in words."""
        if self.choices:
            return " or ".join(self.choices)
        number = "whole number" if self.kind is int else "number"
        return f"a {number} between {self.low:g} and {self.high:g}" + (f" {self.unit}" if self.unit else "")

    def checked(self, value: object) -> Setting:
        """Return a value in its type; SimError where it is of another one or beyond the limits."""
        if self.choices:
            if value in self.choices:
                return str(value)
        elif isinstance(value, int if self.kind is int else (int, float)) and not isinstance(value, bool):
            number = self.kind(value)
            if self.low <= number <= self.high:
                return number  # type: ignore[no-any-return]
        raise SimError(f"{self.name} is {value!r}; it must be {self.wanted}")

    def parsed(self, text: str) -> Setting:
        """Return the value of a text."""
        try:
            value = text if self.choices else self.kind(text)
        except ValueError:
            raise SimError(f"{self.name} is {text!r}; it must be {self.wanted}") from None
        return self.checked(value)


def _key(default: Setting, about: str, unit: str = "", **details: Any) -> Any:
    return field(default=default, metadata={"about": about, "unit": unit, **details})


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Settings of a simulation that a user may change by name."""

    table_friction: float = _key(
        1.0, "Factor on the friction between cloth and table; the product with 0.5 worked best of 0.3, 0.5 and 0.8.",
        low=0.0, high=5.0,
    )  # fmt: skip
    mass_factor: float = _key(1.0, "Factor on the cloth's mass.", low=0.3, high=4.0)
    stiffness_factor: float = _key(
        1.0, "Factor on the cloth's springs and their damping; above 1 it stretches less.", low=0.3, high=2.0
    )
    bending_factor: float = _key(1.0, "Factor on the cloth's resistance to bending.", low=0.1, high=10.0)
    friction_factor: float = _key(1.0, "Factor on the cloth's own friction, also cloth on cloth.", low=0.1, high=4.0)
    size_factor: float = _key(1.0, "Factor on the cloth's sides; its mass grows with the area.", low=0.5, high=1.7)
    hanger_width: float = _key(
        HELD_STRETCH, "Distance at which the robot holds the corners.", "widths of the cloth", low=0.97, high=1.06
    )
    control: Control = _key(  # noqa: RUF009  # the choices are the type's
        "impedance", "How the arm is driven: it yields to a push, or its joints are stiff.",
        choices=get_args(Control),
    )  # fmt: skip
    arm_stiffness_n_m: float = _key(
        STIFFNESS_N_M, "Stiffness of the arm's springs along x, y and z, critically damped; of hanger and impedance.",
        "N/m", low=100.0, high=1500.0,
    )  # fmt: skip
    step_s: float = _key(
        STEP_S, "Duration of a control step; all episodes of a session share it.", "s", low=0.01, high=1.0, varies=False
    )
    observation_latency_steps: int = _key(
        0, "Age of what the policy sees, which is also what is recorded; its time is that of arrival.",
        "steps", low=0, high=10,
    )  # fmt: skip
    action_latency_steps: int = _key(
        0, "Steps after which an action is carried out; the robot rests until the first one.", "steps", low=0, high=10
    )
    camera_x_m: float = _key(0.0, "Camera moved forward; its pose is known to the perception.", "m", low=-0.3, high=0.3)
    camera_y_m: float = _key(0.0, "Camera moved to the robot's left.", "m", low=-0.3, high=0.3)
    camera_z_m: float = _key(0.0, "Camera moved up.", "m", low=-0.3, high=0.3)
    camera_tilt_deg: float = _key(0.0, "Camera turned up.", "degrees", low=-10.0, high=10.0)
    camera_width_px: int = _key(
        CAMERA_WIDTH_PX, "Columns of the image; it has three quarters as many rows.", "px", low=160, high=1280
    )
    light_azimuth_deg: float = _key(
        LIGHT_AZIMUTH_DEG, "Direction of the light, from the robot's front towards its left.", "degrees",
        low=-180.0, high=180.0,
    )  # fmt: skip
    light_height_deg: float = _key(LIGHT_HEIGHT_DEG, "Height of the light.", "degrees", low=10.0, high=90.0)
    light_strength: float = _key(1.0, "Factor on the light, not on what the room sheds.", low=0.2, high=2.0)
    depth_noise: float = _key(
        1.0, "Factor on the depth camera's error and on its share of missing pixels; 0 is the true depth.",
        low=0.0, high=5.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name, key in keys().items():
            object.__setattr__(self, name, key.checked(getattr(self, name)))

    def changed_cloth(self, cloth: ClothSpec) -> ClothSpec:
        """Return a cloth as the factors and the robot's hold change it."""
        size = self.size_factor
        return replace(
            cloth,
            length_m=size * cloth.length_m,
            width_m=size * cloth.width_m,
            mass_kg=self.mass_factor * size**2 * cloth.mass_kg,
            elastic_n_m=self.stiffness_factor * cloth.elastic_n_m,
            damping_n_s_m=self.stiffness_factor * cloth.damping_n_s_m,
            bending_n_m=self.bending_factor * cloth.bending_n_m,
            friction=self.friction_factor * cloth.friction,
            held_stretch=self.hanger_width,
        )


@cache
def keys() -> Mapping[str, Key]:
    """Return every key by its name."""
    return {
        item.name: Key(name=item.name, default=cast(Setting, item.default), **item.metadata)
        for item in fields(Conditions)
    }


def key_of(name: str) -> Key:
    """Return the key of that name; SimError names the nearest known one."""
    if name not in keys():
        near = difflib.get_close_matches(name, keys(), 1, cutoff=0.4)
        hint = f"did you mean {near[0]}? " if near else ""
        raise SimError(f"unknown key {name!r}; {hint}`layflat config` lists every key")
    return keys()[name]


def parse_settings(texts: Iterable[str]) -> dict[str, Setting]:
    """Return the values of texts ``KEY=VALUE``; SimError where one is none, or a key has two values."""
    found: dict[str, Setting] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise SimError(f"setting {text!r} must be KEY=VALUE, such as table_friction=0.8")
        parsed = key_of(name.strip()).parsed(value.strip())
        if found.setdefault(name.strip(), parsed) != parsed:
            raise SimError(f"{name.strip()} is set to {found[name.strip()]} and to {parsed}; give it once")
    return found


def changed(settings: Mapping[str, Any]) -> dict[str, Setting]:
    """Return the keys among the settings of a recorded simulation that have another value than by default."""
    return {name: settings[name] for name, key in keys().items() if settings.get(name, key.default) != key.default}


def as_texts(settings: Mapping[str, Setting]) -> Sequence[str]:
    """Return settings as texts that `parse_settings` reads."""
    return [f"{name}={value}" for name, value in settings.items()]
