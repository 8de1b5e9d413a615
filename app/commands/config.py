"""`layflat config`: every key that `--set` takes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.metrics import write_json
from layflat.sim.conditions.keys import Key, keys

HEADER = ("key", "type", "unit", "default", "limits", "meaning")
WIDTH = 200


def list_keys(json: Path | None, *, force: bool) -> None:
    """Print a line for each key, and write them to a JSON file where asked for."""
    if json is not None:
        validators.writable_file(json, suffix=".json", force=force)
        write_json(json, {"keys": [described(key) for key in keys().values()]})
    print_table(HEADER, [cells(key) for key in keys().values()], left=6, width=WIDTH)


def cells(key: Key) -> tuple[str, ...]:
    """Return the columns of HEADER."""
    limits = ", ".join(key.choices) or f"{key.low:g} to {key.high:g}"
    return key.name, key.kind.__name__, key.unit, str(key.default), limits, key.about


def described(key: Key) -> dict[str, Any]:
    """Return a key as JSON values."""
    limits = [None if math.isinf(end) else end for end in (key.low, key.high)]
    known = {"name": key.name, "type": key.kind.__name__, "unit": key.unit, "default": key.default}
    return {**known, "limits": limits, "choices": list(key.choices), "varies": key.varies, "meaning": key.about}
