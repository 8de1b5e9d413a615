"""Every key, type and unit of a session file, spelled once.

A session file is a robomimic data set. ``N`` is the number of ticks of an episode, ``A`` the size of an action,
``D`` three times the number of cloth nodes, ``H`` and ``W`` an image's height and width::

    /data                 attributes: SESSION_ATTRIBUTES
    /data/demo_<int>      attributes: DEMO_ATTRIBUTES; data sets: FIELDS
    /mask/<key>           names of demos as bytes: all, success, failure, partial

Whatever a policy may see lies under ``obs`` and ``next_obs``; what only the simulator knows is ``states`` and
``truth/``. The observation after the last tick is the last row of ``next_obs``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from data.types import Task

SCHEMA = "layflat-session"
SCHEMA_VERSION = 1
"""Raised by one whenever a reader of the old form would misread the new one."""

DATA = "data"
MASK = "mask"
OBS = "obs"
NEXT_OBS = "next_obs"
TRUTH = "truth"
DEMO_NAME = re.compile(r"demo_(0|[1-9][0-9]{0,8})")
"""robomimic parses the integer after the underscore of every member of /data."""

ENV_NAMES: dict[Task, str] = {"hanger": "layflat/HangerPlace-v0", "pickers": "layflat/PickersPlace-v0"}
ENV_TYPE_GYM = 2
"""robomimic's EnvType.GYM_TYPE."""

# Attributes of /data.
TOTAL = "total"
"""Sum of num_samples."""
ENV_ARGS = "env_args"
"""JSON: type, env_name, env_version, env_kwargs, as robomimic reads them."""
SCHEMA_NAME = "schema"
TASK = "task"
CLOTH = "cloth"
TICK_S = "tick_s"
VERSION = "schema_version"
ACTION_LIMIT = "action_limit_m"

# Further attributes of each demo.
NUM_SAMPLES = "num_samples"
SEED = "seed"
SOURCE = "source"
OUTCOME = "outcome"
SUCCESS = "success"
STOPPED_BY = "stopped_by"
DISTURBANCE = "disturbance"
WALL_S = "wall_s"
START = "start"
"""JSON object: name -> number."""
PROVENANCE = "provenance"
"""JSON object: versions, platform, created_utc, command."""
UID = "uid"
"""Hexadecimal identity of the recording; tells the same episode in two files from two episodes with one number."""
DIGEST = "attributes_sha256"
"""Over the canonical JSON of all other attributes: HDF5 itself does not check the strings among them."""
UNIT = "unit"
"""Attribute of every data set."""

SESSION_ATTRIBUTES: dict[str, type] = {
    SCHEMA_NAME: str,
    VERSION: int,
    TASK: str,
    CLOTH: str,
    TICK_S: float,
    ACTION_LIMIT: float,
    TOTAL: int,
    ENV_ARGS: str,
}
DEMO_ATTRIBUTES: dict[str, type] = {
    UID: str,
    VERSION: int,
    NUM_SAMPLES: int,
    TASK: str,
    CLOTH: str,
    TICK_S: float,
    ACTION_LIMIT: float,
    SEED: int,
    SOURCE: str,
    DISTURBANCE: str,
    OUTCOME: str,
    SUCCESS: bool,
    STOPPED_BY: str,
    WALL_S: float,
    START: str,
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
    optional: bool = False
    packed: bool = False
    """Compressed without loss (lzf): worth its time for images only."""


ACTIONS = "actions"
"""action_m / action_limit_m, within -1..1."""
ACTION_M = "action_m"
"""The displacement itself: dividing by the limit and multiplying again does not give back every bit."""
ACTION_STD = "action_std"
"""NaN in all columns of a tick whose policy gave no confidence."""
PHASE = "phase"
REWARDS = "rewards"
"""Camera contact portion after the tick minus before it: an episode's rewards sum to what it gained, and a policy that
only sees pixels is paid by pixels. Grades come from ``truth/``."""
DONES = "dones"
"""1 on the last tick, 0 before."""
STATES = "states"
"""Cloth nodes before the tick, (x, y, z) of node 0, then of node 1, ..."""
FINAL_STATE = f"{TRUTH}/final_state"
CONTACT_TRUE = f"{TRUTH}/contact_portion_true"
FLAT_AREA = f"{TRUTH}/flat_area"
RGB = "rgb"
DEPTH = "depth"

OBSERVATION_FIELDS: tuple[Field, ...] = (
    Field(key="time_s", dtype="<f8", shape=("N", 1), unit="s"),
    Field(key="corner_positions", dtype="<f8", shape=("N", 6), unit="m"),
    Field(key="holder_position", dtype="<f8", shape=("N", 3), unit="m"),
    Field(key="word", dtype="<f8", shape=("N", 2), unit="1"),
    Field(key="word_strength", dtype="<f8", shape=("N", 1), unit="1"),
    Field(key="contact_portion", dtype="<f8", shape=("N", 1), unit="1"),
    Field(key=RGB, dtype="|u1", shape=("N", "H", "W", 3), unit="1", optional=True, packed=True),
    Field(key=DEPTH, dtype="<f4", shape=("N", "H of depth", "W of depth", 1), unit="m", optional=True, packed=True),
)
"""Under ``obs`` as it was before a tick, under ``next_obs`` after it; keys are the names in data.types.Observation."""


def _under(group: str) -> tuple[Field, ...]:
    return tuple(
        Field(key=f"{group}/{f.key}", dtype=f.dtype, shape=f.shape, unit=f.unit, optional=f.optional, packed=f.packed)
        for f in OBSERVATION_FIELDS
    )


FIELDS: tuple[Field, ...] = (
    Field(key=ACTIONS, dtype="<f8", shape=("N", "A"), unit="1"),
    Field(key=ACTION_M, dtype="<f8", shape=("N", "A"), unit="m"),
    Field(key=ACTION_STD, dtype="<f8", shape=("N", "A"), unit="m"),
    Field(key=PHASE, dtype="|S8", shape=("N",), unit="1"),
    Field(key=REWARDS, dtype="<f8", shape=("N",), unit="1"),
    Field(key=DONES, dtype="|u1", shape=("N",), unit="1"),
    Field(key=STATES, dtype="<f8", shape=("N", "D"), unit="m"),
    Field(key=FINAL_STATE, dtype="<f8", shape=("D",), unit="m"),
    Field(key=CONTACT_TRUE, dtype="<f8", shape=("N+1", 1), unit="1"),
    Field(key=FLAT_AREA, dtype="<f8", shape=("N+1", 1), unit="1"),
    *_under(OBS),
    *_under(NEXT_OBS),
)


def demo_name(number: int) -> str:
    return f"demo_{number}"


def demo_number(name: str) -> int:
    """The integer of ``demo_<int>``; names are ordered by it, or demo_10 would come before demo_2."""
    return int(name.removeprefix("demo_"))
