"""Every key, type, unit and frame of a session file.

A session file is a robomimic data set. ``N`` is the number of steps of an episode, ``A`` the size of an action, ``D``
three times the number of cloth nodes, ``J`` the number of joints, ``H`` and ``W`` an image's height and width::

    /data                 attributes: SESSION_ATTRIBUTES
    /data/demo_<int>      attributes: DEMO_ATTRIBUTES; data sets: FIELDS
    /mask/<key>           names of demos as bytes: all, success, failure, partial
    /index                summary of each demo (layflat.data.session.index); optional

What a policy may see is under ``obs`` and ``next_obs``. What only a simulator knows is ``states`` and
``ground_truth/``, which an episode of a real robot does not have. The observation after the last step is the last row
of ``next_obs``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from layflat.data.robot import RobotSpec

SCHEMA = "layflat-episodes"
SCHEMA_VERSION = 1
"""Raised by one whenever a reader of the previous form would misread the new one."""
UNRELEASED_SCHEMA = "layflat-session"
"""Name of the schema before the first release; such files are refused."""

DATA, MASK, INDEX, OBS, NEXT_OBS, GROUND_TRUTH = "data", "mask", "index", "obs", "next_obs", "ground_truth"
DEMO_NAME = re.compile(r"demo_(0|[1-9][0-9]{0,8})")
"""robomimic parses the integer after the underscore of every member of /data."""

ENV_NAME = "layflat/ClothPlace-v0"
ENV_TYPE_GYM = 2
"""robomimic's EnvType.GYM_TYPE."""

# Attributes of /data.
TOTAL = "total"
"""Sum of num_samples."""
ENV_ARGS = "env_args"
"""JSON for robomimic: type, env_name, env_version, env_kwargs. Never read here."""
SCHEMA_NAME = "schema"
VERSION = "schema_version"
FRAMES = "frames"
"""JSON object: description of each frame of reference."""
ROBOT = "robot"
ACTION_AXES = "action_axes"
"""JSON list of [name, point, axis] for each component of an action, see layflat.data.robot."""
TASK, PHYSICS, CLOTH, STEP_S = "task", "physics", "cloth", "step_s"
DESCRIPTOR = "descriptor"
"""Descriptor that computed obs/word."""
ACTION_LIMIT = "action_limit_m"

# Further attributes of each demo.
NUM_SAMPLES = "num_samples"
SEED, SOURCE, OUTCOME, SUCCESS, STOPPED_BY, WALL_S = "seed", "source", "outcome", "success", "stopped_by", "wall_s"
DISTURBANCE = "disturbance"
DISTURBANCES = "disturbances"
"""JSON list of objects: name, first_step, last_step (null: not over), plan (an object)."""
START = "start"
"""JSON object: name -> number."""
SIM_CONFIG = "sim_config"
"""JSON object: settings of the simulation."""
FIRST_STEP = "first_step"
CONTACT_START, CONTACT_FINAL = "contact_start", "contact_final"
CONTACT_TRUE_FINAL, FLAT_AREA_FINAL = "contact_final_true", "flat_area_final"
"""Copies from the arrays, so that a table of episodes needs none of them; checked when the arrays are read. The last
two are absent without ground truth."""
PROVENANCE = "provenance"
"""JSON object: versions, platform, created_utc, command, operator."""
CAMERA = "camera"
"""JSON object: pinhole camera of the observations, see layflat.data.camera; absent where it is not known."""
MESH_ROWS, MESH_COLUMNS = "mesh_rows", "mesh_columns"
"""Shape of the grid of nodes; absent where it is not known."""
NOTE = "episode_note"
"""Note of a person; absent where there is none."""
DECISION_S = "decision_s"
"""Mean wall time of a decision of the policy; absent where it is not known."""
UID = "uid"
"""Hexadecimal identity of the recording: distinguishes a copy from another episode of the same number."""
DIGEST = "attributes_sha256"
"""SHA-256 of the canonical JSON of all other attributes: HDF5 itself does not check the strings among them."""
TEXTS = "texts"
"""JSON object of all text attributes, stored at its length: the only text that is read here. Text attributes
themselves are of variable length, so that other programs get text and not bytes; HDF5 keeps it in its global heap,
which has no checksum, and in which a few wrong bytes keep the library in an endless loop."""
UNIT, FRAME, COLUMNS, DESCRIPTION = DATASET_ATTRIBUTES = ("unit", "frame", "columns", "description")
"""Attributes of every data set: its unit, its frame of reference, the names of its columns, and what it is."""

FRAME_TEXTS: Mapping[str, str] = {
    "world": "right-handed, z up, table top at z = 0, x to the robot's front, y to its left",
    "table": "x and y of world",
    "image": "rows from the top, columns from the left",
    "camera": "along the optical axis, per pixel of the image; 0 where the sensor has no value",
    "none": "a quantity without a frame",
}

SESSION_KEYS = (ROBOT, ACTION_AXES, TASK, PHYSICS, CLOTH, STEP_S, DESCRIPTOR)
"""Attributes that all episodes of a session share."""
_SHARED: dict[str, type] = {VERSION: int, **dict.fromkeys(SESSION_KEYS, str), STEP_S: float, ACTION_LIMIT: float}
SESSION_ATTRIBUTES: dict[str, type] = {SCHEMA_NAME: str, **_SHARED, TOTAL: int, FRAMES: str}
DEMO_ATTRIBUTES: dict[str, type] = {
    **_SHARED,
    **dict.fromkeys((UID, SOURCE, OUTCOME, STOPPED_BY, DISTURBANCE, DISTURBANCES, START, SIM_CONFIG, PROVENANCE), str),
    **dict.fromkeys((NUM_SAMPLES, SEED, FIRST_STEP), int),
    **dict.fromkeys((WALL_S, CONTACT_START, CONTACT_FINAL, CONTACT_TRUE_FINAL, FLAT_AREA_FINAL), float),
    SUCCESS: bool,
}
GROUND_TRUTH_ATTRIBUTES = (CONTACT_TRUE_FINAL, FLAT_AREA_FINAL)
OPTIONAL_ATTRIBUTES: dict[str, type] = {CAMERA: str, NOTE: str, DECISION_S: float, MESH_ROWS: int, MESH_COLUMNS: int}


@dataclass(frozen=True)
class Field:
    """One data set of a demo."""

    key: str
    """Path inside the demo."""
    dtype: str
    """numpy type string, little endian."""
    shape: tuple[int | str, ...]
    """Lengths. A letter is bound where it first occurs and must then agree within the demo; HAND_SHAPE stands for the
    robot's `hand_shape`. Data sets of four dimensions are images, which are compressed without loss."""
    unit: str = "1"
    frame: str = "none"
    """Key of FRAME_TEXTS."""
    columns: tuple[str, ...] = ()
    """Names along the last axis; empty where the robot, the cloth or the image decides on them."""
    optional: bool = False
    default: float | None = None
    """Value of every step where the data set is absent."""

    @property
    def description(self) -> str:
        """Meaning of the data set, for its attribute."""
        text = DESCRIPTIONS[self.key.removeprefix(f"{NEXT_OBS}/").removeprefix(f"{OBS}/")]
        moment = {OBS: "before the step: ", NEXT_OBS: "after the step: "}
        return moment.get(self.key.partition("/")[0], "") + text


HAND_SHAPE = "hand shape"
ACTIONS = "actions"
"""action_m / action_limit_m, within -1..1."""
ACTION_M = "action_m"
"""The displacement itself: dividing by the limit and multiplying again does not give back every bit."""
ACTION_STD = "action_std"
"""NaN in all columns of a step whose policy gave no confidence."""
PHASE = "phase"
REWARDS = "rewards"
"""Camera contact portion after the step minus before it: an episode's rewards sum to what it gained, and a policy that
only sees pixels is paid by pixels. Grades come from the ground truth."""
DONES = "dones"
"""1 on the last step, 0 before."""
STATES = "states"
"""Cloth nodes before the step, (x, y, z) of node 0, then of node 1, ..."""
FINAL_STATE = f"{GROUND_TRUTH}/final_state"
CONTACT_TRUE = f"{GROUND_TRUTH}/contact_portion_true"
FLAT_AREA = f"{GROUND_TRUTH}/flat_area"
JOINTS = "initial_joints"
FORCE = "force_n"
DRAG_NODE, DRAG_TARGET = "drag_node", "drag_target_m"
"""-1 and NaN in a step without a drag."""
INTERVENTION = "intervention"
HAND = "hand_m"
"""NaN in a step in which no hand guides the robot."""
RGB, DEPTH = "rgb", "depth"
INDEX_DESCRIPTION = "one line of JSON for each demo: a summary, so that opening need not read them all"
DESCRIPTIONS: Mapping[str, str] = {
    "time_s": "simulated time since the first step",
    "corner_positions": "where the robot holds the two corners: the one at +y, then the one at -y",
    "holder_position": "centre of the robot's holder, or the midpoint of its two points",
    "word": "wrinkle contraction direction: unit vector on the table, x >= 0; (0, 0) where there is none",
    "word_strength": "strength of word, at least 0",
    "contact_portion": "share of the flat cloth's area that the camera sees resting on the table; 1 is all of it",
    RGB: "camera image",
    DEPTH: "depth image; points follow from attribute camera of the demo",
    ACTIONS: "action_m over action_limit_m, within -1 to 1",
    ACTION_M: "displacement of the robot in the step",
    ACTION_STD: "standard deviation of the policy's action; NaN where it is unknown",
    PHASE: "place: until the policy stops; disturb: the robot rests while a disturbance acts; repair: after that",
    REWARDS: "gain of contact_portion in the step",
    DONES: "1 on the last step, 0 before",
    STATES: "nodes of the cloth before the step, x y z of each; rows of the mesh (mesh_rows x mesh_columns) from the"
    " free edge to the held edge",
    FINAL_STATE: "nodes of the cloth after the last step, as in states",
    CONTACT_TRUE: "share of the cloth's area that rests on the table, by the mesh; 1 is all of it",
    FLAT_AREA: "signed area of the cloth on the table over all of it, by the mesh; 1 is flat, a reverse side negative",
    JOINTS: "joint angles of the arm before the first step",
    FORCE: "mean total force of disturbances and drags on the cloth",
    DRAG_NODE: "node that a person dragged; -1 for none",
    DRAG_TARGET: "where a person dragged it; NaN for none",
    HAND: "where a hand guided the robot; NaN for none",
    INTERVENTION: "1 where a person decided although a policy was in control",
}
"""Meaning of each data set, by key, or by its name under ``obs`` and ``next_obs``."""

_XYZ = ("x", "y", "z")
_CORNERS = ("x1", "y1", "z1", "x2", "y2", "z2")

OBSERVATION_FIELDS: tuple[Field, ...] = (
    Field("time_s", "<f8", ("N", 1), "s", columns=("time",)),
    Field("corner_positions", "<f8", ("N", 6), "m", "world", _CORNERS),
    Field("holder_position", "<f8", ("N", 3), "m", "world", _XYZ),
    Field("word", "<f8", ("N", 2), "1", "table", ("x", "y")),
    Field("word_strength", "<f8", ("N", 1), columns=("strength",)),
    Field("contact_portion", "<f8", ("N", 1), columns=("portion",)),
    Field(RGB, "|u1", ("N", "H", "W", 3), "1", "image", ("red", "green", "blue"), optional=True),
    Field(DEPTH, "<f4", ("N", "H of depth", "W of depth", 1), "m", "camera", ("depth",), optional=True),
)
"""Under ``obs`` as before a step, under ``next_obs`` as after it; keys are attributes of layflat.data.Observation."""
OBSERVATION_LIMITS: Mapping[str, tuple[float, float]] = {
    "time_s": (0.0, 3600.0),
    "corner_positions": (-2.0, 2.0),
    "holder_position": (-2.0, 2.0),
    "word": (-1.0, 1.0),
    "word_strength": (0.0, 10.0),
    "contact_portion": (0.0, 1.0),
    RGB: (0, 255),
    DEPTH: (0.0, 10.0),
}
"""Least and greatest value for the spaces of Gymnasium, which cut off what is outside: robots keep to less than 1 m,
Gabor responses stay below 1, and noise may take a contact portion slightly above 1."""
GROUND_TRUTH_FIELDS: tuple[Field, ...] = (
    Field(STATES, "<f8", ("N", "D"), "m", "world", optional=True),
    Field(FINAL_STATE, "<f8", ("D",), "m", "world", optional=True),
    Field(CONTACT_TRUE, "<f8", ("N+1", 1), columns=("portion",), optional=True),
    Field(FLAT_AREA, "<f8", ("N+1", 1), columns=("area",), optional=True),
)
"""All of them are there, or none."""
STEP_FIELDS: tuple[Field, ...] = (
    Field(ACTION_M, "<f8", ("N", "A"), "m", "world"),
    Field(ACTION_STD, "<f8", ("N", "A"), "m", "world"),
    Field(PHASE, "|S8", ("N",)),
    Field(FORCE, "<f8", ("N", 3), "N", "world", _XYZ, optional=True, default=0.0),
    Field(DRAG_NODE, "<i8", ("N",), optional=True, default=-1),
    Field(DRAG_TARGET, "<f8", ("N", 3), "m", "world", _XYZ, optional=True, default=math.nan),
    Field(HAND, "<f8", ("N", HAND_SHAPE), "m", "world", _XYZ, optional=True, default=math.nan),
    Field(INTERVENTION, "|u1", ("N",), optional=True, default=0),
)
"""Data of each step. The optional ones are absent where no step has any."""

FIELDS: Mapping[str, Field] = {
    field.key: field
    for field in (
        Field(ACTIONS, "<f8", ("N", "A"), "1", "world"),
        Field(REWARDS, "<f8", ("N",)),
        Field(DONES, "|u1", ("N",)),
        Field(JOINTS, "<f8", ("J",), "rad", optional=True),
        *STEP_FIELDS,
        *GROUND_TRUTH_FIELDS,
        *(replace(field, key=f"{OBS}/{field.key}") for field in OBSERVATION_FIELDS),
        *(replace(field, key=f"{NEXT_OBS}/{field.key}") for field in OBSERVATION_FIELDS),
    )
}
"""All data sets of a demo, by key."""
STEP_KEYS = tuple(key for key, field in FIELDS.items() if field.shape[0] == "N")
"""Data sets with one row per step."""
MAY_BE_NAN = (ACTION_STD, DRAG_TARGET, HAND)
"""Data sets in which NaN means that a step has no value."""


def row_shape(field: Field, robot: RobotSpec, lengths: Mapping[str, int]) -> tuple[int, ...] | None:
    """Return the shape of one row of a data set, or None where a letter of it has no length in ``lengths``."""
    shape: list[int] = []
    for length in field.shape[1:]:
        if length == HAND_SHAPE:
            shape += robot.hand_shape
        elif length == "A":
            shape.append(robot.size)
        elif isinstance(length, int):
            shape.append(length)
        elif length in lengths:
            shape.append(lengths[length])
        else:
            return None
    return tuple(shape)


def columns_of(field: Field, robot: RobotSpec) -> tuple[str, ...]:
    """Return the names of the columns of a data set; empty where they have none."""
    return robot.action_names if field.shape[-1] == "A" else field.columns


def demo_name(number: int) -> str:
    """Return the name of a demo by its number."""
    return f"demo_{number}"


def demo_number(name: str) -> int:
    """Return the number of a demo; names are ordered by it, or demo_10 would come before demo_2."""
    return int(name.removeprefix("demo_"))
