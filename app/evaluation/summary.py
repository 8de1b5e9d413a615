"""What a batch's rows amount to: groups with intervals, and differences between what is paired."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from layflat.app.support.statistics import GROUP, statistics
from layflat.data.types import FLAT_AREA

MEASURES = ("contact_final", "gain", "flat_area_final", "contact_final_true")
"""``gain`` is contact_final - contact_disturbed."""
PLACE = ["robot", "cloth", "disturbance"]


def with_measures(rows: pd.DataFrame) -> pd.DataFrame:
    """With the columns ``gain`` and ``success``: flat at the end, and neither unstable nor crashed."""
    gain = rows["contact_final"] - rows["contact_disturbed"]
    success = (rows["flat_area_final"] > FLAT_AREA) & ~rows["unstable"] & ~rows["crashed"]
    return rows.assign(gain=gain, success=success)


def summary_of(rows: pd.DataFrame) -> dict[str, Any]:
    """``groups``, ``paired`` (between policies), ``twins`` (disturbed less undisturbed) and counts of what crashed.

    Each measure has n, mean, min, max and ci95, the 95 % bootstrap interval of the mean; None where there is nothing
    to say. Crashed episodes count in a group's n and as no success, and have no measures.
    """
    measured = with_measures(rows)
    return {
        "groups": [_group(key, group) for key, group in measured.groupby(list(GROUP), sort=False)],
        "paired": list(_paired(measured)),
        "twins": list(_twins(measured)),
        "crashed": int(measured["crashed"].sum()),
        "tried_again": int((measured["attempts"] > 1).sum()),
    }


def wilson(successes: int, n: int) -> list[float]:
    """95 % Wilson interval of a share."""
    interval = binomtest(successes, n).proportion_ci(confidence_level=0.95, method="wilson")
    return [float(interval.low), float(interval.high)]


def measure(values: pd.Series) -> dict[str, Any]:
    """n, mean, min, max and ci95 [low, high] of the values that are there."""
    known = values.dropna().to_numpy(float)
    found = {name: None if np.isnan(value) else value for name, value in statistics(known).items()}
    return {
        "n": len(known),
        **{name: found[name] for name in ("mean", "min", "max")},
        "ci95": [found["low"], found["high"]],
    }


def _group(key: tuple[str, ...], group: pd.DataFrame) -> dict[str, Any]:
    successes = int(group["success"].sum())
    return {
        **dict(zip(GROUP, key, strict=True)),
        "n": len(group),
        "crashed": int(group["crashed"].sum()),
        "unstable": int(group["unstable"].sum()),
        "success_rate": successes / len(group),
        "success_wilson95": wilson(successes, len(group)),
        **{name: measure(group[name]) for name in MEASURES},
    }


def _paired(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """``b`` less ``a`` from the same starts, for each two policies that met them."""
    for key, met in rows.groupby(PLACE, sort=False):
        by_policy = {name: group.set_index("seed") for name, group in met.groupby("policy", sort=False)}
        for a, b in combinations(by_policy, 2):
            yield {**dict(zip(PLACE, key, strict=True)), "a": a, "b": b, **_difference(by_policy[a], by_policy[b])}


def _twins(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """What a disturbance has left behind in the end: the disturbed episode less its undisturbed twin."""
    for key, group in rows.groupby(["policy", "robot", "cloth"], sort=False):
        by_case = {name: case.set_index("seed") for name, case in group.groupby("disturbance", sort=False)}
        alone = by_case.pop("none", None)
        for name, case in by_case.items():
            if alone is not None:
                whose = dict(zip(("policy", "robot", "cloth"), key, strict=True))
                yield {**whose, "disturbance": name, **_difference(alone, case)}


def _difference(a: pd.DataFrame, b: pd.DataFrame) -> dict[str, Any]:
    names = [*MEASURES, "success"]
    both = (b[names].astype(float) - a[names].astype(float)).dropna(how="all")
    return {name: measure(both[name]) for name in names}
