"""Tables of an evaluation's rows."""

from __future__ import annotations

import pandas as pd

from layflat.app.evaluation.summary import with_measures
from layflat.app.report.blocks import Table
from layflat.app.report.policies import policies_of
from layflat.app.report.table_cells import END_HEADER, end_cells, gain_cell, mean_cell, range_cell, values
from layflat.app.support.formatting import MISSING, percent, points, ratio
from layflat.app.support.statistics import describe

GROUP_HEADER = (
    "policy", "n", "placed", "final [95\u00a0%\u00a0CI]", "min,\u00a0max", "regained, points [95\u00a0%\u00a0CI]",
    *END_HEADER,
)  # fmt: skip
GROUP_NOTE = (
    "Means over the episodes that have the value; contact is the camera's contact portion (Eq. 4-7), mesh contact and "
    "flat area (of the area on the table, reverse side negative) are the simulator's, all three at the end. Intervals "
    "of means are 95 % bootstrap intervals over episodes, that of a share is Wilson's; flat counts flat area above "
    "0.97 (contact, where there is no simulator), and an episode that diverged or crashed (lost) as not flat."
)
EPISODE_HEADER = (
    "policy", "seed", "start", "placed", "disturbed", "final", "regained", "mesh contact", "flat area", "steps",
    "stopped by", "wall",
)  # fmt: skip
FAILURE_HEADER = ("policy", "what", "episodes", "of", "seeds", "why")
MAX_SEEDS = 12


def group_table(rows: pd.DataFrame) -> Table:
    """Make one line for each policy, over all given rows."""
    lines = []
    for policy in policies_of(rows):
        group = with_measures(rows[rows["policy"] == policy])
        final = values(group, "contact_final")
        placed = percent(describe(values(group, "contact_placed")).mean)
        numbers = (placed, mean_cell(final), range_cell(final), gain_cell(values(group, "gain")))
        lines.append((policy, str(len(group)), *numbers, *end_cells(group)))
    return Table(GROUP_HEADER, tuple(lines))


def episode_table(rows: pd.DataFrame) -> Table:
    """Make one line for each episode."""
    lines = []
    for row in with_measures(rows).to_dict(orient="records"):
        contacts = [row[name] for name in ("contact_start", "contact_placed", "contact_disturbed", "contact_final")]
        mesh, area = percent(row["contact_final_true"]), ratio(row["flat_area_final"])
        steps, wall = (
            MISSING if pd.isna(n) else f"{n:.{d}f}{u}" for n, d, u in ((row["steps"], 0, ""), (row["wall_s"], 1, " s"))
        )
        cells = (*map(percent, contacts), points(row["gain"]), mesh, area, steps, row["stopped_by"], wall)
        lines.append((row["policy"], str(row["seed"]), *cells))
    return Table(EPISODE_HEADER, tuple(lines), runs=tuple(rows["run"]) if "run" in rows else ())


def failure_table(rows: pd.DataFrame) -> Table:
    """Make one line for each policy, kind of failure and reason."""
    lines = []
    for policy in policies_of(rows):
        group = rows[rows["policy"] == policy]
        reasons = group.assign(what=failures(group), why=_reasons(group))
        for (what, why), part in reasons.groupby(["what", "why"], sort=True):
            if what:
                lines.append((policy, what, str(len(part)), str(len(group)), _seeds(part), why or MISSING))
    return Table(FAILURE_HEADER, tuple(lines))


def failures(rows: pd.DataFrame) -> pd.Series:
    """Return the kind of failure of each row, "" for a success."""
    kinds = pd.Series("", index=rows.index, dtype=object)
    kinds[~with_measures(rows)["success"]] = "not flat at the end"
    kinds[rows["stopped_by"] == "step_limit"] = "cut off by the step limit"
    kinds[rows["stopped_by"] == "interrupted"] = "interrupted"
    kinds[rows["unstable"].fillna(False).astype(bool)] = "diverged"
    kinds[rows["crashed"].astype(bool)] = "crashed"
    return kinds


def _reasons(rows: pd.DataFrame) -> pd.Series:
    """Return the recorded reason, or else how the episode stopped."""
    recorded = rows["reason"].fillna("").astype(str) if "reason" in rows else pd.Series("", index=rows.index)
    return recorded.where(recorded != "", "stopped by " + rows["stopped_by"].astype(str))


def _seeds(rows: pd.DataFrame) -> str:
    seeds = sorted(set(map(int, rows["seed"])))
    more = f", and {len(seeds) - MAX_SEEDS} more" if len(seeds) > MAX_SEEDS else ""
    return ", ".join(map(str, seeds[:MAX_SEEDS])) + more
