"""Episodes as rows, and JSON files of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from app.atomic import write_text
from data.types import Episode

JSON_SCHEMA = 1

COLUMNS = (
    "policy",
    "task",
    "cloth",
    "seed",
    "disturbance",
    "contact_start",
    "contact_placed",
    "contact_disturbed",
    "contact_final",
    "contact_final_true",
    "flat_area_final",
    "ticks",
    "stopped_by",
    "unstable",
    "crashed",
    "sim_s",
    "wall_s",
)


def placed_tick(episode: Episode) -> int | None:
    """Index into ``observations()`` of the moment the place phase ended, or None where there is no such phase."""
    bounds = episode.phase_bounds("place")
    return bounds[1] if bounds else None


def disturbed_tick(episode: Episode) -> int | None:
    """As placed_tick, of the moment the (last) disturbance was over."""
    bounds = episode.phase_bounds("disturb")
    return bounds[1] if bounds else None


def row_of(episode: Episode) -> dict[str, Any]:
    """One row in the order of COLUMNS; contact portions in 0..1 (noise above 1 is cut off), None for no moment."""
    contact = np.clip(episode.contact(), 0.0, 1.0)

    def at(tick: int | None) -> float | None:
        return None if tick is None else float(contact[tick])

    return {
        "policy": episode.source,
        "task": episode.task,
        "cloth": episode.cloth,
        "seed": episode.seed,
        "disturbance": episode.disturbance,
        "contact_start": float(contact[0]),
        "contact_placed": at(placed_tick(episode)),
        "contact_disturbed": at(disturbed_tick(episode)),
        "contact_final": float(contact[-1]),
        "contact_final_true": episode.final_truth.contact_portion_true,
        "flat_area_final": episode.final_truth.flat_area,
        "ticks": len(episode.steps),
        "stopped_by": episode.stopped_by,
        "unstable": episode.unstable,
        "crashed": episode.stopped_by == "crashed",
        "sim_s": len(episode.steps) * episode.tick_s,
        "wall_s": episode.wall_s,
    }


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write one JSON object with the schema number first; whole or not at all; numpy numbers and arrays are fine."""
    text = json.dumps({"schema": JSON_SCHEMA, **content}, indent=1, allow_nan=False, default=_plain)
    write_text(path, text + "\n")


def _plain(value: object) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in a JSON file")
