"""Order and colour of the policies in every table and figure."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from layflat.app.report.thesis_numbers import BASELINE, PROPOSED

COLORS: Mapping[str, str] = {
    BASELINE: "#c2571a",
    PROPOSED: "#0f766e",
    "gp-contact": "#6d5bd0",
    "gp-direction": "#b8336a",
    "gp-baseline+drag-rule": "#4d7c0f",
    "gp-finish+recovery+steady": "#1d4ed8",
    "word": "#0f766e",
    "stretch-right": "#c2571a",
    "random": "#667382",
}
OTHER_COLORS = ("#0369a1", "#a16207", "#475569", "#9f1239")


def policy_color(policy: str, number: int = 0) -> str:
    """Return the policy's colour; ``number`` tells policies without one of their own apart."""
    return COLORS.get(policy, OTHER_COLORS[number % len(OTHER_COLORS)])


def policies_of(rows: pd.DataFrame) -> list[str]:
    """Return the policies in the order of tables: the baseline, the proposed method, the others as they come."""
    found = list(dict.fromkeys(rows["policy"])) if len(rows) else []
    first = [name for name in (BASELINE, PROPOSED) if name in found]
    return first + [name for name in found if name not in first]
