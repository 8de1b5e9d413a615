"""config.json: what an evaluation's folder contains, so that a later run continues the same evaluation.

Policies, cloths, seeds and disturbances may be added; none may become another under the same name.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import JSON_SCHEMA
from layflat.app.workers.sim_options import parse_conditions
from layflat.app.workers.work_item import DisturbanceCase
from layflat.data.atomic_files import write_text
from layflat.data.provenance import capture_provenance
from layflat.policy.spec import PolicySpec

NOT_COMPARED = frozenset({"provenance", "taught"})
"""A model that was trained again to the same numbers is the same."""


def merge_config(plan: EvaluationPlan, path: Path) -> dict[str, Any]:
    """Return what ``path`` says, if there is such a file, merged with ``plan``; UsageError where they contradict.

    ``invocations`` has an entry for each command that worked on the folder.
    """
    new = _described(plan)
    there = _read(path)
    for key, kind in (("policies", "policy"), ("disturbances", "disturbance")):
        new[key] = _united(there.get(key, {}), new[key], kind, path)
    for key in ("robots", "cloths", "seeds"):
        new[key] = list(dict.fromkeys([*there.get(key, ()), *new[key]]))
    for key in ("task", "start", "descriptor", "settings", "variation"):
        if there.get(key, new[key]) != new[key]:
            raise UsageError(_contradiction(path, f"{key} is {there[key]}", str(new[key])))
    new["taught"] = _united_taught([*there.get("taught", ()), *plan.taught])
    new["invocations"] = [*there.get("invocations", ()), vars(capture_provenance())]
    return new


def save_config(path: Path, config: Mapping[str, Any]) -> None:
    """Write what `merge_config` returned."""
    write_text(path, json.dumps(config, indent=1) + "\n")


def sort_key(config: Mapping[str, Any]) -> Any:
    """Return the key of the order of finished rows: that of `EvaluationPlan.items`."""
    names = {
        "robot": list(config["robots"]),
        "cloth": list(config["cloths"]),
        "policy": [name.split(" ", 1)[1] for name in config["policies"]],
        "disturbance": list(config["disturbances"]),
    }
    places = {column: {name: place for place, name in reversed(list(enumerate(n)))} for column, n in names.items()}

    def key(row: Mapping[str, str]) -> tuple[int, ...]:
        robot, cloth, policy, disturbance = (places[name].get(row[name], -1) for name in places)
        return robot, cloth, int(row["seed"]), policy, disturbance

    return key


def _read(path: Path) -> dict[str, Any]:
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except ValueError:
        there = None
    if not isinstance(there, dict) or there.get("schema") != JSON_SCHEMA or not isinstance(there.get("policies"), dict):
        raise UsageError(
            f"{path} is not what `layflat evaluate` wrote; choose another --out, or --force to start again"
        )
    return there


def _described(plan: EvaluationPlan) -> dict[str, Any]:
    return {
        "schema": JSON_SCHEMA,
        "task": plan.task,
        "start": plan.start,
        "descriptor": plan.descriptor,
        "settings": parse_conditions(plan.settings),
        "variation": plan.variation.described(),
        "robots": list(plan.robots),
        "cloths": list(plan.cloths),
        "policies": {f"{robot} {policy.label}": _described_policy(policy) for robot, policy in plan.entries},
        "disturbances": {case.name: _described_case(case) for case in plan.all_cases},
        "seeds": list(plan.seeds),
        "limit_s": plan.limit_s,
    }


def _described_policy(policy: PolicySpec) -> dict[str, Any]:
    described: dict[str, Any] = {"builtin": policy.builtin, "wrappers": list(policy.wrappers), "model": None}
    if policy.foreign is not None:
        described["foreign"] = str(getattr(policy.foreign, "url", None) or getattr(policy.foreign, "text", ""))
    if policy.model is not None:
        described["model"] = {
            "policy": policy.model.policy,
            "cloth": policy.model.cloth,
            "descriptor": policy.model.descriptor,
            "sha256": fingerprint(policy.model),
        }
    return described


def _described_case(case: DisturbanceCase) -> list[dict[str, Any]]:
    described: list[dict[str, Any]] = json.loads(json.dumps([asdict(item) for item in case.schedule]))
    return described


def fingerprint(value: object) -> str:
    """Return the SHA-256 of a frozen value: its fields' names, numbers and arrays, apart from NOT_COMPARED."""
    digest = hashlib.sha256()
    _feed(digest, value)
    return digest.hexdigest()


def _feed(digest: Any, value: object) -> None:
    if is_dataclass(value):
        value = {item.name: getattr(value, item.name) for item in fields(value) if item.name not in NOT_COMPARED}
    if isinstance(value, Mapping):
        for key in sorted(value):
            digest.update(f"<{key}>".encode())
            _feed(digest, value[key])
    elif isinstance(value, np.ndarray):
        digest.update(f"[{value.dtype.str}{value.shape}]".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        for item in value:
            digest.update(b",")
            _feed(digest, item)
    else:
        digest.update(repr(value).encode())


def _united(there: Mapping[str, Any], new: Mapping[str, Any], kind: str, path: Path) -> dict[str, Any]:
    for name, described in new.items():
        if name in there and there[name] != described:
            raise UsageError(_contradiction(path, f"{kind} {name} is another one", "this one"))
    return {**there, **new}


def _united_taught(entries: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    united: dict[tuple[str, ...], dict[str, Any]] = {}
    for entry in entries:
        names = {name: value for name, value in entry.items() if name != "seeds"}
        one = united.setdefault(tuple(names.values()), {**names, "seeds": []})
        one["seeds"] = sorted({*one["seeds"], *entry["seeds"]})
    return list(united.values())


def _contradiction(path: Path, has: str, wanted: str) -> str:
    return (
        f"{path.parent} contains an evaluation whose {has}, not {wanted}; give another --out, or --force to start again"
    )
