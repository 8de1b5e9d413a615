"""Legend of the tables: the unit and the meaning of each column, by the names that all tables share."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from layflat.data.atomic_files import write_text
from layflat.data.robot import RobotSpec

LEGEND = "columns.json"
"""Name of the file beside the tables."""
_PORTION = "contact portion, the share of the flat cloth's area that the camera sees on the table"
COLUMN_TEXTS: Mapping[str, tuple[str, str]] = {
    "episode": ("", "name of the episode"),
    "policy": ("", "policy that acted"),
    "robot": ("", "name of the robot"),
    "task": ("", "name of the task"),
    "physics": ("", "name of the simulator, or real"),
    "cloth": ("", "name of the cloth"),
    "seed": ("", "random seed of the episode"),
    "source": ("", "who decided: a device, a policy, or both"),
    "outcome": ("", "success, failure or partial"),
    "stopped_by": ("", "why it ended: converged, threshold, step_limit, unstable, interrupted or crashed"),
    "disturbance": ("", "name of the disturbance or suite, or none"),
    "decision_ms": ("ms", "mean wall time of a decision of the policy"),
    "conditions": ("", "conditions that are not the usual ones, as JSON: keys of layflat config"),
    "steps": ("", "number of control steps"),
    "step_s": ("s", "simulated time of a control step"),
    "contact_start": ("1", f"{_PORTION}, before the first step"),
    "contact_placed": ("1", f"{_PORTION}, when the policy first stopped"),
    "contact_disturbed": ("1", f"{_PORTION}, after the disturbance"),
    "contact_final": ("1", f"{_PORTION}, after the last step"),
    "contact_final_true": ("1", "share of the cloth's area that rests on the table at the end, by the mesh"),
    "flat_area_final": ("1", "signed area of the cloth on the table over all of it, at the end, by the mesh"),
    "unstable": ("", "whether the simulation diverged"),
    "crashed": ("", "whether the process failed"),
    "sim_s": ("s", "simulated time of the episode"),
    "wall_s": ("s", "wall time of the episode"),
    "run": ("", "name of the episode's file in runs"),
    "start": ("", "name of the start"),
    "attempts": ("", "how often the episode was tried"),
    "reason": ("", "why it crashed"),
    "step": ("", "number of the control step, from 0; the row after the last step is the end"),
    "phase": ("", "place, disturb or repair"),
    "time_s": ("s", "simulated time since the first step"),
    **{f"corner{c}_{axis}_m": ("m", f"held corner {c} at {'+-'[c - 1]}y: {axis}") for c in (1, 2) for axis in "xyz"},
    **{f"holder_{axis}_m": ("m", f"centre of the robot's holder: {axis}") for axis in "xyz"},
    **{f"word_{axis}": ("1", f"wrinkle contraction direction on the table: {axis}; 0 and 0: none") for axis in "xy"},
    "word_strength": ("1", "strength of the wrinkle contraction direction"),
    "contact_portion": ("1", f"{_PORTION}, before the step"),
    "contact_portion_true": ("1", "share of the cloth's area that rests on the table, by the mesh"),
    "flat_area": ("1", "signed area of the cloth on the table over all of it, by the mesh"),
    **{f"force_{axis}_n": ("N", f"mean total force of disturbances and drags: {axis}") for axis in "xyz"},
    "drag_node": ("", "node that a person dragged"),
    **{f"drag_{axis}_m": ("m", f"where a person dragged it: {axis}") for axis in "xyz"},
    "intervention": ("", "1 where a person decided although a policy was in control"),
}
"""Unit ("" for none, "1" for a share or a direction) and meaning by column; positions are in the world frame."""


def write_legend(folder: Path, tables: Mapping[str, Iterable[str]], robot: RobotSpec | None = None) -> None:
    """Write ``columns.json`` beside tables: unit and meaning of each of their columns."""
    texts = dict(COLUMN_TEXTS)
    for name in robot.action_names if robot is not None else ():
        texts[f"{name}_m"] = ("m", f"action: displacement {name} in the step")
        texts[f"std_{name}_m"] = ("m", f"standard deviation of the policy's {name}")
    content = {
        "schema": 1,
        "tables": {
            table: {name: dict(zip(("unit", "is"), texts[name], strict=True)) for name in names}
            for table, names in tables.items()
        },
    }
    write_text(folder / LEGEND, json.dumps(content, indent=1) + "\n")
