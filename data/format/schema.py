"""Every key, type, unit and frame of a session file, spelled once.

A session file is a robomimic data set. ``N`` is the number of steps of an episode, ``A`` the size of an action,
``D`` three times the number of cloth nodes, ``J`` the number of joints, ``H`` and ``W`` an image's height and width::

    /data                 attributes: SESSION_ATTRIBUTES
    /data/demo_<int>      attributes: DEMO_ATTRIBUTES; data sets: FIELDS
    /mask/<key>           names of demos as bytes: all, success, failure, partial
    /index                what is known of each demo without opening it (layflat.data.session.index); may be missing

Whatever a policy may see lies under ``obs`` and ``next_obs``; what only the simulator knows is ``states`` and
``truth/``. The observation after the last step is the last row of ``next_obs``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from layflat.data.robot import RobotSpec

SCHEMA = "layflat-session"
SCHEMA_VERSION = 3
"""Raised by one whenever a reader of the old form would misread the new one; layflat.data.format.migrate reads the
older ones."""

DATA = "data"
MASK = "mask"
INDEX = "index"
OBS = "obs"
NEXT_OBS = "next_obs"
TRUTH = "truth"
DEMO_NAME = re.compile(r"demo_(0|[1-9][0-9]{0,8})")
"""robomimic parses the integer after the underscore of every member of /data."""

ENV_NAME = "layflat/ClothPlace-v0"
ENV_TYPE_GYM = 2
"""robomimic's EnvType.GYM_TYPE."""

# Attributes of /data.
TOTAL = "total"
"""Sum of num_samples."""
ENV_ARGS = "env_args"
"""JSON for robomimic: type, env_name, env_version, env_kwargs. For others only; never read here."""
SCHEMA_NAME = "schema"
ROBOT = "robot"
ACTION_AXES = "action_axes"
"""JSON list of [name, point, axis] for each component of an action, see layflat.data.robot."""
TASK = "task"
PHYSICS = "physics"
CLOTH = "cloth"
STEP_S = "step_s"
DESCRIPTOR = "descriptor"
"""What obs/word was computed by."""
VERSION = "schema_version"
ACTION_LIMIT = "action_limit_m"
FRAMES = "frames"
"""JSON object: what each frame that a data set names is."""

# Further attributes of each demo.
NUM_SAMPLES = "num_samples"
SEED = "seed"
SOURCE = "source"
OUTCOME = "outcome"
SUCCESS = "success"
STOPPED_BY = "stopped_by"
DISTURBANCE = "disturbance"
DISTURBANCES = "disturbances"
"""JSON list of objects: name, first_step, last_step (null: not over), plan (an object)."""
WALL_S = "wall_s"
START = "start"
"""JSON object: name -> number."""
SIM_CONFIG = "sim_config"
"""JSON object: settings of the simulation."""
FIRST_STEP = "first_step"
CONTACT_START = "contact_start"
CONTACT_FINAL = "contact_final"
CONTACT_TRUE_FINAL = "contact_true_final"
FLAT_AREA_FINAL = "flat_area_final"
"""Copies from the arrays, so that a table of episodes needs none of them; checked when the arrays are read."""
PROVENANCE = "provenance"
"""JSON object: versions, platform, created_utc, command, operator."""
UID = "uid"
"""Hexadecimal identity of the recording; tells the same episode in two files from two episodes with one number."""
DIGEST = "attributes_sha256"
"""Over the canonical JSON of all other attributes: HDF5 itself does not check the strings among them."""
UNIT = "unit"
FRAME = "frame"
COLUMNS = "columns"
"""Attributes of every data set: its unit, its frame of reference, and the names of its columns."""

FRAME_TEXTS: Mapping[str, str] = {
    "world": "right-handed, z up, table top at z = 0, x to the robot's front, y to its left",
    "table": "x and y of world",
    "image": "rows from the top, columns from the left",
    "camera": "along the optical axis, per pixel of the image; 0 where the sensor has no value",
    "none": "a quantity without a frame",
}

SESSION_ATTRIBUTES: dict[str, type] = {
    SCHEMA_NAME: str,
    VERSION: int,
    ROBOT: str,
    ACTION_AXES: str,
    TASK: str,
    PHYSICS: str,
    CLOTH: str,
    STEP_S: float,
    DESCRIPTOR: str,
    ACTION_LIMIT: float,
    TOTAL: int,
    FRAMES: str,
}
DEMO_ATTRIBUTES: dict[str, type] = {
    UID: str,
    VERSION: int,
    NUM_SAMPLES: int,
    ROBOT: str,
    ACTION_AXES: str,
    TASK: str,
    PHYSICS: str,
    CLOTH: str,
    STEP_S: float,
    DESCRIPTOR: str,
    ACTION_LIMIT: float,
    SEED: int,
    SOURCE: str,
    DISTURBANCE: str,
    DISTURBANCES: str,
    OUTCOME: str,
    SUCCESS: bool,
    STOPPED_BY: str,
    WALL_S: float,
    START: str,
    SIM_CONFIG: str,
    FIRST_STEP: int,
    CONTACT_START: float,
    CONTACT_FINAL: float,
    CONTACT_TRUE_FINAL: float,
    FLAT_AREA_FINAL: float,
    PROVENANCE: str,
}


@dataclass(frozen=True, kw_only=True)
class Field:
    """One data set of a demo."""

    key: str
    """Path inside the demo."""
    dtype: str
    """numpy type string, little endian."""
    shape: tuple[int | str, ...]
    """Lengths; a letter is bound where it first occurs and must then agree within the demo."""
    unit: str
    frame: str = "none"
    """Key of FRAME_TEXTS."""
    columns: tuple[str, ...] = ()
    """Names of the columns; empty where the robot, the cloth or the image decides on them."""
    optional: bool = False
    absent: float | None = None
    """What every step has where the data set is missing."""
    packed: bool = False
    """Compressed without loss: worth its time for images only."""


ACTIONS = "actions"
"""action_m / action_limit_m, within -1..1."""
ACTION_M = "action_m"
"""The displacement itself: dividing by the limit and multiplying again does not give back every bit."""
ACTION_STD = "action_std"
"""NaN in all columns of a step whose policy gave no confidence."""
PHASE = "phase"
REWARDS = "rewards"
"""Camera contact portion after the step minus before it: an episode's rewards sum to what it gained, and a policy that
only sees pixels is paid by pixels. Grades come from ``truth/``."""
DONES = "dones"
"""1 on the last step, 0 before."""
STATES = "states"
"""Cloth nodes before the step, (x, y, z) of node 0, then of node 1, ..."""
FINAL_STATE = f"{TRUTH}/final_state"
CONTACT_TRUE = f"{TRUTH}/contact_portion_true"
FLAT_AREA = f"{TRUTH}/flat_area"
JOINTS = f"{TRUTH}/initial_joints"
FORCE = "force_n"
PULL_NODE = "pull_node"
PULL_TARGET = "pull_target_m"
"""NaN where nothing is pulled at, and -1 for its node."""
INTERVENTION = "intervention"
HAND = "hand_m"
"""NaN where no hand drew the holder; of one hand, the second place is NaN.

These five are missing where no step has any."""
RGB = "rgb"
DEPTH = "depth"

_XYZ = ("x", "y", "z")
_CORNERS = ("x1", "y1", "z1", "x2", "y2", "z2")

OBSERVATION_FIELDS: tuple[Field, ...] = (
    Field(key="time_s", dtype="<f8", shape=("N", 1), unit="s", columns=("time",)),
    Field(key="corner_positions", dtype="<f8", shape=("N", 6), unit="m", frame="world", columns=_CORNERS),
    Field(key="holder_position", dtype="<f8", shape=("N", 3), unit="m", frame="world", columns=_XYZ),
    Field(key="word", dtype="<f8", shape=("N", 2), unit="1", frame="table", columns=("x", "y")),
    Field(key="word_strength", dtype="<f8", shape=("N", 1), unit="1", columns=("strength",)),
    Field(key="contact_portion", dtype="<f8", shape=("N", 1), unit="1", columns=("portion",)),
    Field(
        key=RGB,
        dtype="|u1",
        shape=("N", "H", "W", 3),
        unit="1",
        frame="image",
        columns=("red", "green", "blue"),
        optional=True,
        packed=True,
    ),
    Field(
        key=DEPTH,
        dtype="<f4",
        shape=("N", "H of depth", "W of depth", 1),
        unit="m",
        frame="camera",
        columns=("depth",),
        optional=True,
        packed=True,
    ),
)
"""Under ``obs`` as it was before a step, under ``next_obs`` after it; keys are the names in
layflat.data.types.Observation."""


def _under(group: str) -> tuple[Field, ...]:
    return tuple(replace(field, key=f"{group}/{field.key}") for field in OBSERVATION_FIELDS)


FIELDS: tuple[Field, ...] = (
    Field(key=ACTIONS, dtype="<f8", shape=("N", "A"), unit="1", frame="world"),
    Field(key=ACTION_M, dtype="<f8", shape=("N", "A"), unit="m", frame="world"),
    Field(key=ACTION_STD, dtype="<f8", shape=("N", "A"), unit="m", frame="world"),
    Field(key=PHASE, dtype="|S8", shape=("N",), unit="1"),
    Field(key=REWARDS, dtype="<f8", shape=("N",), unit="1"),
    Field(key=DONES, dtype="|u1", shape=("N",), unit="1"),
    Field(key=STATES, dtype="<f8", shape=("N", "D"), unit="m", frame="world"),
    Field(key=FINAL_STATE, dtype="<f8", shape=("D",), unit="m", frame="world"),
    Field(key=CONTACT_TRUE, dtype="<f8", shape=("N+1", 1), unit="1", columns=("portion",)),
    Field(key=FLAT_AREA, dtype="<f8", shape=("N+1", 1), unit="1", columns=("area",)),
    Field(key=JOINTS, dtype="<f8", shape=("J",), unit="rad", optional=True),
    Field(key=FORCE, dtype="<f8", shape=("N", 3), unit="N", frame="world", columns=_XYZ, optional=True, absent=0.0),
    Field(key=PULL_NODE, dtype="<i8", shape=("N",), unit="1", optional=True, absent=-1),
    Field(
        key=PULL_TARGET,
        dtype="<f8",
        shape=("N", 3),
        unit="m",
        frame="world",
        columns=_XYZ,
        optional=True,
        absent=math.nan,
    ),
    Field(
        key=HAND,
        dtype="<f8",
        shape=("N", 6),
        unit="m",
        frame="world",
        columns=_CORNERS,
        optional=True,
        absent=math.nan,
    ),
    Field(key=INTERVENTION, dtype="|u1", shape=("N",), unit="1", optional=True, absent=0),
    *_under(OBS),
    *_under(NEXT_OBS),
)


def columns_of(field: Field, robot: RobotSpec) -> tuple[str, ...]:
    """Return the names of the columns of a data set; empty where they have none."""
    return robot.action_names if field.shape[-1] == "A" else field.columns


def demo_name(number: int) -> str:
    return f"demo_{number}"


def demo_number(name: str) -> int:
    """The integer of ``demo_<int>``; names are ordered by it, or demo_10 would come before demo_2."""
    return int(name.removeprefix("demo_"))
