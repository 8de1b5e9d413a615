"""What is known of an episode without reading its arrays."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, get_type_hints

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object
from layflat.data.types import Outcome, StoppedBy


@dataclass(frozen=True, kw_only=True)
class DemoInfo:
    """One line of a table of episodes; contact portions are the camera's unless they say ``true``."""

    uid: str
    """Identity of the recording; stays when an episode is copied, merged or renumbered."""
    robot: str
    cloth: str
    descriptor: str
    step_s: float
    n_steps: int
    first_step: int
    """Above 0 where steps before these were cut off."""
    seed: int
    source: str
    outcome: Outcome
    stopped_by: StoppedBy
    disturbance: str
    wall_s: float
    contact_start: float
    contact_final: float
    contact_true_final: float
    flat_area_final: float
    created_utc: str
    operator: str
    images: bool
    """Whether rgb or depth was kept."""
    version: int
    """Of the schema that the file has it in; what is read is always of the present one."""

    @property
    def success(self) -> bool:
        return self.outcome == "success"

    @property
    def duration_s(self) -> float:
        """Simulated time."""
        return self.n_steps * self.step_s


_PLAIN = {str: str, int: int, float: float, bool: bool}
FIELD_NAMES = tuple(field.name for field in fields(DemoInfo))
_TYPES = [_PLAIN.get(get_type_hints(DemoInfo)[name], str) for name in FIELD_NAMES]


def info_of(attributes: Mapping[str, Attribute], *, images: bool, version: int) -> DemoInfo:
    """From the attributes of a demo, in the present schema."""
    provenance = json_object(attributes, schema.PROVENANCE)
    same = {name: attributes[name] for name in FIELD_NAMES if name in attributes}
    values: dict[str, Any] = same | {
        "n_steps": attributes[schema.NUM_SAMPLES],
        "created_utc": str(provenance.get("created_utc", "")),
        "operator": str(provenance.get("operator", "")),
        "images": images,
        "version": version,
    }
    return DemoInfo(**values)


def info_to_row(info: DemoInfo) -> dict[str, Attribute]:
    return {name: getattr(info, name) for name in FIELD_NAMES}


def info_from_row(row: Mapping[str, Any]) -> DemoInfo:
    """The reverse of info_to_row for a row that cannot be trusted; DataError where a value is of the wrong type."""
    values = {name: row.get(name) for name in FIELD_NAMES}
    if [type(value) for value in values.values()] != _TYPES:
        raise DataError(f"{json.dumps(values)[:80]} is no line of an index")
    return DemoInfo(**values)  # type: ignore[arg-type]
