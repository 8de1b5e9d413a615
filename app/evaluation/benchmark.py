"""Layflat Bench: one definition, evaluations on its seeds, and the scores of policies.

The definition is one TOML file. Each of its variations is an evaluation in a folder of its own, which continues like
any other.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.suites import cases_of
from layflat.app.evaluation.summary import with_measures
from layflat.app.support.errors import UsageError
from layflat.app.support.statistics import describe, wilson_interval
from layflat.app.workers.sim_options import parse_variation
from layflat.policy.spec import PolicySpec

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FILE = "layflat-bench-1.toml"
USUAL = "usual"
"""Variation in which nothing is drawn."""
HELD_OUT = 2**31
"""Least of the seeds that a phrase gives; published seeds, and those of demonstrations and defaults, are below."""
START = ("robot", "cloth", "variation", "seed")
"""Columns of a placement, from which the episodes of all its disturbances come."""
BREAKDOWNS = ("robot", "cloth", "disturbance", "variation")


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """The plan of a benchmark: robots x cloths x disturbances x variations x seeds."""

    name: str
    version: str
    about: str
    robots: tuple[str, ...]
    cloths: tuple[str, ...]
    disturbances: tuple[str, ...]
    """Besides the undisturbed episode."""
    variations: tuple[str, ...]
    seeds: tuple[int, ...]
    phrase: str | None = None
    """Phrase that gave the seeds; None: they are the published ones."""
    quick: bool = False

    @property
    def title(self) -> str:
        """Name and version, and what was not the whole of it."""
        parts = ["quick"] * self.quick + ["held-out seeds"] * (self.phrase is not None)
        return f"{self.name}, version {self.version}" + (f" ({', '.join(parts)})" if parts else "")

    def plans(self, policies: Sequence[PolicySpec]) -> dict[str, EvaluationPlan]:
        """Return an evaluation for each variation; a model takes part with its own robot."""
        return {
            name: EvaluationPlan(
                policies=tuple(policies),
                robots=self.robots,
                cloths=self.cloths,
                seeds=self.seeds,
                cases=tuple(case for text in self.disturbances for case in cases_of(text)),
                variation=parse_variation([] if name == USUAL else [name]),
            )
            for name in self.variations
        }

    def described(self) -> dict[str, Any]:
        """Return the definition as JSON values, with the SHA-256 of its file."""
        found = {item.name: getattr(self, item.name) for item in fields(self)}
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in found.items()}
        return {**plain, "sha256": hashlib.sha256(_text().encode()).hexdigest()}


def _text() -> str:
    return (resources.files("layflat.app.evaluation") / "benchmark_files" / FILE).read_text(encoding="utf-8")


def benchmark(*, quick: bool = False, phrase: str | None = None) -> Benchmark:
    """Return Layflat Bench 1, or its quick part; with a ``phrase`` on seeds that follow from it."""
    content = tomllib.loads(_text())
    content |= content.pop("quick") if quick else {}
    first, count = int(content["first_seed"]), int(content["seeds"])
    names: dict[str, Any] = {name: tuple(content[name]) for name in ("robots", "cloths", "disturbances", "variations")}
    return Benchmark(
        name=content["name"],
        version=content["version"],
        about=content["about"],
        **names,
        seeds=tuple(range(first, first + count)) if phrase is None else seeds_of(phrase, count),
        phrase=phrase,
        quick=quick,
    )


def seeds_of(phrase: str, count: int) -> tuple[int, ...]:
    """Return the seeds of a phrase, from 2^31 up: by SHA-256 of the phrase, a line break and 0, 1, ..."""
    if not phrase.strip():
        raise UsageError("--phrase is empty; give any text, from which the held-out seeds follow")

    def drawn() -> Iterator[int]:
        number = 0
        while True:
            digest = hashlib.sha256(f"{phrase}\n{number}".encode("utf-8", "surrogateescape")).digest()
            yield HELD_OUT + int.from_bytes(digest[:4], "big") % HELD_OUT
            number += 1

    found: dict[int, None] = {}
    for seed in drawn():
        found[seed] = None
        if len(found) == count:
            return tuple(found)
    raise AssertionError


def planned_rows(rows: pd.DataFrame, plan: EvaluationPlan) -> pd.DataFrame:
    """Return the rows of a plan among those of a folder, which may hold more."""
    return rows[rows["run"].isin({run for item in plan.items() for run in item.run_ids})]


def with_scores(rows: pd.DataFrame) -> pd.DataFrame:
    """Add ``score``, 0 to 1: the flat area at the end; 0 for a cloth that is turned over, diverged or crashed."""
    measured = with_measures(rows)
    lost = measured["crashed"].astype(bool) | measured["unstable"].fillna(False).astype(bool)
    area = measured["flat_area_final"].astype(float).fillna(0.0).clip(0.0, 1.0)
    return measured.assign(score=area.where(~lost, 0.0))


def scored(rows: pd.DataFrame) -> dict[str, Any]:
    """Return the score of rows of one policy; its interval is over placements, as their episodes share a past."""
    starts = rows.groupby(list(START), sort=False)["score"].mean().to_numpy(float)
    successes, numbers = int(rows["success"].sum()), describe(starts)
    decisions = rows["decision_ms"].dropna()
    return {
        "n": len(rows),
        "starts": len(starts),
        "score": float(rows["score"].mean()),
        "ci95": [None if np.isnan(end) else end for end in (numbers.low, numbers.high)],
        "success_rate": successes / len(rows),
        "success_wilson95": list(wilson_interval(successes, len(rows))),
        "lost": int((rows["crashed"].astype(bool) | rows["unstable"].fillna(False).astype(bool)).sum()),
        "decision_ms": float(decisions.mean()) if len(decisions) else None,
    }


def scores_of(rows: pd.DataFrame, policies: Sequence[PolicySpec]) -> list[dict[str, Any]]:
    """Return an entry for each policy, best first: its score, its cost, and its score in each part."""
    entries = []
    for label in dict.fromkeys(policy.label for policy in policies):
        mine = rows[rows["policy"] == label]
        if not len(mine):
            continue
        specs = [policy for policy in policies if policy.label == label]
        parts = {
            name: {str(value): scored(part) for value, part in mine.groupby(name, sort=False)} for name in BREAKDOWNS
        }
        known: Mapping[str, Any] = {
            "policy": label,
            "robots": list(dict.fromkeys(mine["robot"])),
            "demonstrations": _demonstrations(specs),
        }
        entries.append({**known, **scored(mine), "parts": parts})
    return sorted(entries, key=lambda entry: -entry["score"])


def _demonstrations(policies: Sequence[PolicySpec]) -> int | None:
    """Return how many demonstrations taught a policy, of all its robots; None where it does not say so."""
    if any(policy.foreign is not None for policy in policies):
        return None
    return sum(0 if policy.model is None else policy.model.demonstrations for policy in policies)
