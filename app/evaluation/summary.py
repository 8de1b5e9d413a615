"""Summary of an evaluation's rows: groups with intervals, and differences between paired episodes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import pandas as pd

from layflat.app.evaluation.paired import CONDITION, PAIR, paired_differences
from layflat.app.support.statistics import describe, wilson_interval
from layflat.data.types import FLAT_AREA

GROUP = ("policy", *CONDITION)
MEASURES = ("contact_final", "gain", "flat_area_final", "contact_final_true")
"""``gain`` is contact_final - contact_disturbed."""


def with_measures(rows: pd.DataFrame) -> pd.DataFrame:
    """Add ``gain`` unless there is one, and ``success``: flat at the end, and neither unstable nor crashed.

    The camera's contact portion says whether the cloth is flat where there is no mesh.
    """
    lost = rows["unstable"].fillna(False).astype(bool) | rows["crashed"].astype(bool)
    flat = rows["flat_area_final"].astype(float).fillna(rows["contact_final"].astype(float))
    success = (flat > FLAT_AREA) & ~lost
    if "gain" in rows:
        return rows.assign(success=success)
    gain = rows["contact_final"].astype(float) - rows["contact_disturbed"].astype(float)
    return rows.assign(gain=gain, success=success)


def summary_of(rows: pd.DataFrame) -> dict[str, Any]:
    """Return ``groups``, ``paired`` (between policies), ``twins`` (disturbed less undisturbed) and counts of crashes.

    Each measure has n, mean, min, max and ci95, the 95 % bootstrap interval of the mean; None where there is no value.
    Crashed episodes count in a group's n and as no success, and have no measures.
    """
    measured = with_measures(rows)
    return {
        "groups": [_group(key, group) for key, group in measured.groupby(list(GROUP), sort=False)],
        "paired": list(_paired(measured)),
        "twins": list(_twins(measured)),
        "crashed": int(measured["crashed"].sum()),
        "tried_again": int((measured["attempts"] > 1).sum()),
    }


def _group(key: tuple[str, ...], group: pd.DataFrame) -> dict[str, Any]:
    successes = int(group["success"].sum())
    return {
        **dict(zip(GROUP, key, strict=True)),
        "n": len(group),
        "crashed": int(group["crashed"].sum()),
        "unstable": int(group["unstable"].sum()),
        "success_rate": successes / len(group),
        "success_wilson95": list(wilson_interval(successes, len(group))),
        **{name: describe(group[name].dropna().to_numpy(float)).to_json() for name in MEASURES},
    }


def _paired(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield ``b`` less ``a`` from the same starts, for every two policies of a condition."""
    for key, part in rows.groupby(list(CONDITION), sort=False):
        by_policy = dict(list(part.groupby("policy", sort=False)))
        for a, b in combinations(by_policy, 2):
            condition = dict(zip(CONDITION, key, strict=True))
            yield {**condition, "a": a, "b": b, **_differences(by_policy[b], by_policy[a])}


def _twins(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield what a disturbance changed in the end: the disturbed episode less its undisturbed twin."""
    names = [name for name in GROUP if name != "disturbance"]
    for key, group in rows.groupby(names, sort=False):
        by_case = dict(list(group.groupby("disturbance", sort=False)))
        undisturbed = by_case.pop("none", None)
        for case, disturbed in by_case.items():
            if undisturbed is not None:
                twin = undisturbed.assign(disturbance=case)
                yield {**dict(zip(names, key, strict=True)), "disturbance": case, **_differences(disturbed, twin)}


def _differences(a: pd.DataFrame, b: pd.DataFrame) -> dict[str, Any]:
    names = (*MEASURES, "success")
    a, b = (rows[[*PAIR, *names]] for rows in (a, b))
    return {name: describe(paired_differences(a, b, name)).to_json() for name in names}
