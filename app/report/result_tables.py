"""Tables of many episodes' rows."""

from __future__ import annotations

import pandas as pd

from layflat.app.evaluation.paired import with_gain
from layflat.app.evaluation.summary import wilson, with_measures
from layflat.app.report.tables import Table, interval, order, percent, points, ratio
from layflat.app.support.statistics import statistics

GROUP_HEADER = (
    "policy",
    "n",
    "contact placed",
    "contact final",
    "min,\u00a0max",
    "95\u00a0%\u00a0CI",
    "regained (points)",
    "95\u00a0%\u00a0CI",
    "mesh contact",
    "flat area",
    "flat at the end",
    "Wilson 95\u00a0%",
)
GROUP_NOTE = (
    "Means over the episodes that have the value; contact is the camera's contact portion (Eq. 4-7), mesh contact "
    "and flat area (of the area on the "
    "table, reverse side negative) are the simulator's, all three at the end. Intervals of means are 95 % bootstrap "
    "intervals over episodes; flat counts "
    "flat area above 0.97, and an episode that diverged or crashed as not flat."
)
EVERY_HEADER = (
    "policy",
    "seed",
    "start",
    "placed",
    "disturbed",
    "final",
    "regained",
    "mesh contact",
    "flat area",
    "steps",
    "stopped by",
    "wall",
)
FAILED_HEADER = ("policy", "what", "episodes", "of", "seeds", "why")
SEEDS_SHOWN = 12


def policies_of(rows: pd.DataFrame) -> list[str]:
    """In the order of tables: the baseline, the proposed method, the others as they come."""
    return order(dict.fromkeys(rows["policy"]))


def group_table(rows: pd.DataFrame) -> Table:
    """One line per policy, over all given rows."""
    lines = []
    for policy in policies_of(rows):
        group = with_gain(rows[rows["policy"] == policy])
        final, gain = _numbers(group, "contact_final"), _numbers(group, "gain")
        flat = int(with_measures(group)["success"].sum())
        low, high = wilson(flat, len(group))
        lines.append(
            (
                policy,
                str(len(group)),
                percent(_numbers(group, "contact_placed")["mean"]),
                percent(final["mean"]),
                f"{percent(final['min'])}, {percent(final['max'])}",
                interval(final["low"], final["high"], ".1f"),
                points(gain["mean"]),
                interval(gain["low"], gain["high"], "+.1f"),
                percent(_numbers(group, "contact_final_true")["mean"]),
                _ratio(_numbers(group, "flat_area_final")["mean"]),
                f"{flat} of {len(group)}",
                interval(low, high, ".0f"),
            )
        )
    return Table(GROUP_HEADER, tuple(lines), (True,) * len(lines))


def every_table(rows: pd.DataFrame) -> Table:
    """One line per episode, nothing left out."""
    lines = []
    for row in with_gain(rows).to_dict(orient="records"):
        contacts = [row[name] for name in ("contact_start", "contact_placed", "contact_disturbed", "contact_final")]
        lines.append(
            (
                str(row["policy"]),
                str(row["seed"]),
                *(percent(_float(value)) for value in contacts),
                points(_float(row["gain"])),
                percent(_float(row["contact_final_true"])),
                _ratio(_float(row["flat_area_final"])),
                f"{_float(row['n_steps']):.0f}",
                str(row["stopped_by"]),
                f"{_float(row['wall_s']):.1f} s",
            )
        )
    return Table(EVERY_HEADER, tuple(lines), (True,) * len(lines))


def failed_table(rows: pd.DataFrame) -> Table:
    """What went wrong, by policy and reason: crashed, diverged, cut off by the step limit, or not flat at the end."""
    lines = []
    for policy in policies_of(rows):
        group = rows[rows["policy"] == policy]
        kinds = failures(group)
        for (what, why), part in group.assign(what=kinds, why=_reasons(group)).groupby(["what", "why"], sort=True):
            if what:
                lines.append((policy, what, str(len(part)), str(len(group)), _seeds(part), why or "\u2013"))
    return Table(FAILED_HEADER, tuple(lines), (True,) * len(lines))


def failures(rows: pd.DataFrame) -> pd.Series:
    """What went wrong with each row, "" where nothing did."""
    kinds = pd.Series("", index=rows.index, dtype=object)
    kinds[~with_measures(rows)["success"]] = "not flat at the end"
    kinds[rows["stopped_by"] == "step_limit"] = "cut off by the step limit"
    kinds[rows["stopped_by"] == "interrupted"] = "interrupted"
    kinds[rows["unstable"].fillna(False).astype(bool)] = "diverged"
    kinds[rows["crashed"].astype(bool)] = "crashed"
    return kinds


def _reasons(rows: pd.DataFrame) -> pd.Series:
    """The recorded reason; that of an episode that only is not flat lies in where it stopped."""
    recorded = rows["reason"].fillna("").astype(str) if "reason" in rows else pd.Series("", index=rows.index)
    return recorded.where(recorded != "", "stopped by " + rows["stopped_by"].astype(str))


def _seeds(rows: pd.DataFrame) -> str:
    seeds = sorted({int(seed) for seed in rows["seed"]})
    more = f", and {len(seeds) - SEEDS_SHOWN} more" if len(seeds) > SEEDS_SHOWN else ""
    return ", ".join(map(str, seeds[:SEEDS_SHOWN])) + more


def _numbers(rows: pd.DataFrame, column: str) -> dict[str, float]:
    return statistics(rows[column].dropna().to_numpy(float))


def _float(value: object) -> float:
    return float("nan") if value is None or pd.isna(value) else float(value)  # type: ignore[arg-type, call-overload]


def _ratio(value: float) -> str:
    return "\u2013" if pd.isna(value) else ratio(value)
