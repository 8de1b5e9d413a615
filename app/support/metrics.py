"""Metrics of an episode, one row each, and JSON files."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.support.phases import disturbed_step, placed_step
from layflat.data.atomic_files import write_text
from layflat.data.types import Episode
from layflat.sim.conditions.keys import changed
from layflat.sim.config import SimConfig

JSON_SCHEMA = 1

COLUMNS = (
    "policy",
    "robot",
    "task",
    "cloth",
    "physics",
    "seed",
    "disturbance",
    "contact_start",
    "contact_placed",
    "contact_disturbed",
    "contact_final",
    "contact_final_true",
    "flat_area_final",
    "steps",
    "stopped_by",
    "unstable",
    "crashed",
    "sim_s",
    "wall_s",
    "conditions",
    "decision_ms",
)


def episode_metrics(episode: Episode) -> dict[str, Any]:
    """Return the row of an episode; contact portions in 0..1 (noise above 1 is cut off), None where there is none."""
    contact = np.clip(episode.contact(), 0.0, 1.0)
    ground_truth = episode.final_ground_truth

    def at(step_index: int | None) -> float | None:
        return None if step_index is None else float(contact[step_index])

    return {
        "policy": episode.source,
        "robot": episode.robot.name,
        "task": episode.task,
        "cloth": episode.cloth,
        "physics": episode.physics,
        "seed": episode.seed,
        "disturbance": episode.disturbance,
        "contact_start": float(contact[0]),
        "contact_placed": at(placed_step(episode)),
        "contact_disturbed": at(disturbed_step(episode)),
        "contact_final": float(contact[-1]),
        "contact_final_true": None if ground_truth is None else ground_truth.contact_portion_true,
        "flat_area_final": None if ground_truth is None else ground_truth.flat_area,
        "steps": len(episode.steps),
        "stopped_by": episode.stopped_by,
        "unstable": episode.unstable,
        "crashed": episode.stopped_by == "crashed",
        "sim_s": len(episode.steps) * episode.step_s,
        "wall_s": episode.wall_s,
        "conditions": changed(episode.sim_config),
        "decision_ms": None if episode.decision_s is None else 1000.0 * episode.decision_s,
    }


def crashed_metrics(policy: str, config: SimConfig, seed: int, disturbance: str, reason: str) -> dict[str, Any]:
    """Return the row of an episode that was lost, with the reason beside its metrics."""
    known: dict[str, Any] = {"policy": policy, "seed": seed, "disturbance": disturbance}
    known |= {name: getattr(config, name) for name in ("robot", "task", "cloth", "physics")}
    known["conditions"] = changed(vars(config))
    lost = {"steps": 0, "stopped_by": "crashed", "unstable": False, "crashed": True}
    return dict.fromkeys(COLUMNS) | known | lost | {"reason": reason}


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write one JSON object with the schema number first; whole or not at all; numpy numbers and arrays are fine."""
    text = json.dumps({"schema": JSON_SCHEMA, **content}, indent=1, allow_nan=False, ensure_ascii=False, default=_plain)
    # A lone surrogate, of a file name that is not UTF-8, is no JSON: many parsers refuse its escape.
    write_text(path, re.sub("[\ud800-\udfff]", lambda found: f"\\\\u{ord(found[0]):x}", text) + "\n")


def _plain(value: object) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} cannot be written to a JSON file")
