"""StationConfig: what a station is made of, from a TOML file.

::

    schema = 1
    name = "lab"
    cloth = "towel"                 # a name or a cloth file

    [robot]
    host = "172.16.0.2"
    base_m = [0.25, 0.40, 0.0]      # the robot's base in the table's frame
    ...

    [camera]
    serial = "1234"                 # or bag = "FILE.bag"
    ...
"""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.data.arrays import FloatArray
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.cloth.spec import DEFAULT_CLOTH, ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.robots.hanger import PandaHanger
from layflat.sim.robots.panda import BASE_POSITION_M, CLIP_DROP_M, GRIP_DEPTH_M

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCHEMA = 1
MAX_BYTES = 100_000
HAND_M = 0.1034
"""Distance from the flange to the end effector of a Franka hand, as the robot's controller has it by default."""
Triple = tuple[float, float, float]
T = TypeVar("T")


class StationError(UsageError):
    """The station is not what its file says, or does not do what it should: the work failed."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.exit_status = 1


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """Section ``[robot]``."""

    host: str
    """Address of the robot's control unit."""
    realtime: bool = False
    """Refuse to run without a real-time kernel."""
    base_m: Triple = BASE_POSITION_M
    """The robot's base in the table's frame."""
    base_yaw_deg: float = 0.0
    tool_m: float = round(GRIP_DEPTH_M + CLIP_DROP_M - HAND_M, 4)
    """Distance from the controller's end effector to the corners' midpoint, along the hand."""
    load_kg: float = field(default=0.0, metadata={"limits": (0.0, 3.0)})
    """Hanger and cloth, beyond the hand that the controller knows."""
    stiffness_n_m: float = field(default=400.0, metadata={"limits": (50.0, 3000.0)})
    rotational_stiffness_n_m: float = field(default=40.0, metadata={"limits": (5.0, 300.0)})
    speed_m_s: float = field(default=0.25, metadata={"limits": (0.01, 0.5)})
    """Fastest that the set point may move."""
    force_n: float = field(default=15.0, metadata={"limits": (2.0, 60.0)})
    """Most that the springs may pull, and where the arm counts as pushed."""
    workspace_low_m: Triple = PandaHanger.workspace_low_m
    workspace_high_m: Triple = PandaHanger.workspace_high_m
    watchdog_s: float = field(default=0.5, metadata={"limits": (0.05, 5.0)})
    """Time without news of the robot after which it counts as lost."""


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """Section ``[camera]``: a RealSense, by its serial number, or a recording of one."""

    serial: str = ""
    """Empty: the only one."""
    bag: str = ""
    width: int = field(default=640, metadata={"limits": (160, 1920)})
    height: int = field(default=480, metadata={"limits": (120, 1080)})
    fps: int = field(default=30, metadata={"limits": (5, 90)})
    position_m: Triple = (0.15, -0.72, 0.86)
    rotation_xyzw: tuple[float, float, float, float] = (-0.916, 0.093, -0.039, 0.388)
    """Turn from camera axes (x right, y down, z forward) to the table's frame."""
    warm_up_frames: int = field(default=30, metadata={"limits": (0, 300)})
    """Frames until exposure and white balance are locked."""
    stale_s: float = field(default=0.3, metadata={"limits": (0.02, 5.0)})
    """Age at which a frame is too old."""
    flat_pixels: int = field(default=0, metadata={"limits": (0, 4_000_000)})
    """Pixels of the flat cloth in the table's view, from ``station calibrate cloth``."""
    hue_deg: tuple[float, float] = field(default=(195.0, 255.0), metadata={"limits": (0.0, 360.0)})
    """Colours of the cloth; the first above the second for a range through red."""
    saturation_min: float = field(default=0.35, metadata={"limits": (0.0, 1.0)})
    value_min: float = field(default=0.10, metadata={"limits": (0.0, 1.0)})

    def cam_to_world(self) -> FloatArray:
        """Return the camera's pose, (4, 4)."""
        from scipy.spatial.transform import Rotation

        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(self.rotation_xyzw).as_matrix()
        pose[:3, 3] = self.position_m
        return pose


@dataclass(frozen=True, kw_only=True)
class StationConfig:
    """A whole station file."""

    robot: RobotConfig
    camera: CameraConfig = CameraConfig()
    name: str = "station"
    cloth: str = DEFAULT_CLOTH

    def __post_init__(self) -> None:
        low, high = self.robot.workspace_low_m, self.robot.workspace_high_m
        if not all(a < b for a, b in zip(low, high, strict=True)):
            raise UsageError(f"workspace_low_m {list(low)} must be below workspace_high_m {list(high)}")
        if self.camera.bag and self.camera.serial:
            raise UsageError("the camera has a serial number and a bag; give one of them")

    def cloth_spec(self) -> ClothSpec:
        """Return the station's cloth; UsageError where there is none of that name."""
        try:
            return cloth_spec(self.cloth)
        except SimError as error:
            raise UsageError(str(error)) from None


def read_station(path: Path) -> StationConfig:
    """Return the station of a file; UsageError says in one sentence what is wrong with it."""
    try:
        content = tomllib.loads(validators.read_text(path, "a station file", max_bytes=MAX_BYTES))
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path} is not TOML: {' '.join(str(error).split())}") from None
    if content.pop("schema", None) != SCHEMA:
        raise UsageError(f"{path}: schema must be {SCHEMA}")
    try:
        return _section(StationConfig, content, "")
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


def _section(kind: type[T], values: Mapping[str, Any], prefix: str) -> T:
    """Make a dataclass of a table; every key must be known and of the field's type."""
    hints, known = get_type_hints(kind), {item.name: item for item in fields(kind)}  # type: ignore[arg-type]
    found: dict[str, Any] = {}
    for key, value in values.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            raise UsageError(
                f"unknown key {prefix}{key}; " + (f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}")
            )
        found[key] = _value(prefix + key, value, hints[key], known[key].metadata.get("limits"))
    required = [n for n, item in known.items() if item.default is MISSING and item.default_factory is MISSING]
    missing = [prefix + name for name in required if name not in found]
    if missing:
        raise UsageError(f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing")
    return kind(**found)


def _value(key: str, value: Any, kind: Any, limits: tuple[float, float] | None) -> Any:
    if hasattr(kind, "__dataclass_fields__"):
        if not isinstance(value, Mapping):
            raise UsageError(f"{key} must be a table, [{key}]")
        return _section(kind, value, f"{key}.")
    if get_origin(kind) is tuple:
        kinds = get_args(kind)
        if not isinstance(value, list) or len(value) != len(kinds):
            raise UsageError(f"{key} is {value!r}; it must be a list of {len(kinds)} numbers")
        return tuple(_value(key, item, one, limits) for item, one in zip(value, kinds, strict=True))
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not kind or (kind is float and not math.isfinite(value)):
        wanted = {str: "text", bool: "true or false", int: "a whole number", float: "a finite number"}[kind]
        raise UsageError(f"{key} is {value!r}; it must be {wanted}")
    if limits is not None and not limits[0] <= value <= limits[1]:
        raise UsageError(f"{key} is {value:g}; it must be from {limits[0]:g} to {limits[1]:g}")
    return value


def update_station(path: Path, section: str, values: Mapping[str, Any]) -> None:
    """Write keys of a section into a station file; comments and all else stay."""
    import tomlkit

    from layflat.data.atomic_files import write_text

    document = tomlkit.parse(path.read_text(encoding="utf-8"))
    table = document.setdefault(section, tomlkit.table())
    for key, value in values.items():
        table[key] = value
    write_text(path, tomlkit.dumps(document))
