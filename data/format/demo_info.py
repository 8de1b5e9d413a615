"""DemoInfo: everything about an episode that needs none of its arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, get_args, get_type_hints

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object
from layflat.data.names import storable
from layflat.data.types import Outcome, StoppedBy


@dataclass(frozen=True, kw_only=True)
class DemoInfo:
    """One row of a table of episodes; contact portions are the camera's unless they say ``true``."""

    uid: str
    """Identity of the recording; stays when an episode is copied, merged or renumbered."""
    robot: str
    action_axes: str
    """JSON list of [name, point, axis], see layflat.data.robot."""
    task: str
    physics: str
    cloth: str
    descriptor: str
    step_s: float
    n_steps: int
    first_step: int
    """Number of steps that were cut off before the first one."""
    seed: int
    source: str
    outcome: Outcome
    stopped_by: StoppedBy
    disturbance: str
    wall_s: float
    contact_start: float
    contact_final: float
    contact_final_true: float | None
    """None without ground truth."""
    flat_area_final: float | None
    """None without ground truth."""
    created_utc: str
    operator: str
    images: bool
    """Whether rgb or depth was recorded."""
    note: str = ""
    """Note of a person; empty where there is none."""

    @property
    def success(self) -> bool:
        """Whether the outcome is success."""
        return self.outcome == "success"

    @property
    def duration_s(self) -> float:
        """Simulated duration."""
        return self.n_steps * self.step_s

    @property
    def shared(self) -> dict[str, Attribute]:
        """Attributes that all episodes of a session share."""
        return {key: getattr(self, key) for key in schema.SESSION_KEYS}


FIELD_NAMES = tuple(field.name for field in fields(DemoInfo))
_PLAIN = (str, int, float, bool, type(None))
_TYPES = {
    name: tuple(kind for kind in (get_args(hint) or (hint,)) if kind in _PLAIN) or (str,)
    for name, hint in get_type_hints(DemoInfo).items()
}


def info_of(attributes: Mapping[str, Attribute], *, images: bool) -> DemoInfo:
    """Return the info of a demo with these attributes."""
    provenance = json_object(attributes, schema.PROVENANCE)
    values: dict[str, Any] = dict.fromkeys(schema.GROUND_TRUTH_ATTRIBUTES)
    values |= {name: attributes[name] for name in FIELD_NAMES if name in attributes}
    values |= {key: storable(str(provenance.get(key, ""))) for key in ("created_utc", "operator")}
    values |= {"n_steps": attributes[schema.NUM_SAMPLES], "images": images, "note": attributes.get(schema.NOTE, "")}
    return DemoInfo(**values)


def info_from_row(row: Mapping[str, Any]) -> DemoInfo:
    """Return the info of an untrusted row of the index; DataError where a value is of the wrong type."""
    row = {"note": "", **row}
    values = {name: storable(value) if isinstance(value := row.get(name), str) else value for name in FIELD_NAMES}
    if any(type(value) not in _TYPES[name] for name, value in values.items()):
        raise DataError(f"{json.dumps(values)[:80]} is no row of an index")
    return DemoInfo(**values)  # type: ignore[arg-type]
