"""Episodes as rows, and JSON files of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.support.atomic_write import write_text
from layflat.data.types import Episode

JSON_SCHEMA = 1

COLUMNS = (
    "policy",
    "robot",
    "cloth",
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
)


def placed_step(episode: Episode) -> int | None:
    """Index into ``observations()`` of the moment the place phase ended, or None where there is no such phase."""
    bounds = episode.phase_bounds("place")
    return bounds[1] if bounds else None


def disturbed_step(episode: Episode) -> int | None:
    """As placed_step, of the moment the last disturbance was over: the end, where the episode ended before."""
    spans = disturbed_spans(episode)
    return spans[-1][1] if spans else None


def disturbed_spans(episode: Episode) -> tuple[tuple[int, int], ...]:
    """Indices into ``observations()`` of when each disturbance began, and of when it was over.

    Where none is told of, a phase ``disturb`` counts as one.
    """
    end = len(episode.steps)
    told = ((r.first_step, end if r.last_step is None else r.last_step + 1) for r in episode.disturbances)
    bounds = episode.phase_bounds("disturb")
    return tuple(told) or ((bounds,) if bounds else ())


@dataclass(frozen=True, kw_only=True)
class ContactDip:
    """What one disturbance did to the camera's contact portion, and what came of it; all in 0..1."""

    name: str
    before: float
    """When it began."""
    after: float
    """When it was over."""
    final: float
    """When the next one began, or at the end."""


def disturbed_contacts(episode: Episode) -> tuple[ContactDip, ...]:
    """One for each disturbance of the episode, in their order (the thesis's Table 4-2 has repeated ones)."""
    contact = np.clip(episode.contact(), 0.0, 1.0)
    spans = disturbed_spans(episode)
    names = [record.name for record in episode.disturbances] or [episode.disturbance] * len(spans)
    finals = [*(begun for begun, _ in spans[1:]), len(episode.steps)]
    return tuple(
        ContactDip(
            name=name,
            before=float(contact[begun]),
            after=float(contact[over]),
            final=float(contact[final]),
        )
        for name, (begun, over), final in zip(names, spans, finals, strict=False)
    )


def episode_metrics(episode: Episode) -> dict[str, Any]:
    """One row in the order of COLUMNS; contact portions in 0..1 (noise above 1 is cut off), None for no moment."""
    contact = np.clip(episode.contact(), 0.0, 1.0)
    ground_truth = episode.final_ground_truth

    def at(step_index: int | None) -> float | None:
        return None if step_index is None else float(contact[step_index])

    return {
        "policy": episode.source,
        "robot": episode.robot,
        "cloth": episode.cloth,
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
    }


def crashed_metrics(*, policy: str, robot: str, cloth: str, seed: int, disturbance: str, reason: str) -> dict[str, Any]:
    """The row of an episode that did not come back, with the reason beside."""
    known = {"policy": policy, "robot": robot, "cloth": cloth, "seed": seed, "disturbance": disturbance}
    came = {"steps": 0, "stopped_by": "crashed", "unstable": False, "crashed": True}
    return dict.fromkeys(COLUMNS) | known | came | {"reason": reason}


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
