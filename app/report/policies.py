"""Order and looks of the policies in every table and figure."""

from __future__ import annotations

from typing import Any

import pandas as pd

from layflat.app.media.plot_style import SERIES
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)), (0, (3, 1.2, 1, 1.2, 1, 1.2)))
_numbers: dict[str, int] = {BASELINE: 0, PROPOSED: 1, "stretch-right": 0, "word": 1}
"""Number of each policy's style: those that have one of their own, and the others as they come."""


def style_number(policy: str) -> int:
    """Return the number of the policy's style, the same for as long as the program runs."""
    return _numbers.setdefault(policy, len(_numbers) - 2)


def policy_style(policy: str) -> dict[str, Any]:
    """Return Matplotlib's colour, marker and line style of a policy: no two policies share all three."""
    number = style_number(policy)
    styles = ("color", SERIES), ("marker", MARKERS), ("linestyle", DASHES)
    return {name: values[number % len(values)] for name, values in styles}


def policies_of(rows: pd.DataFrame) -> list[str]:
    """Return the policies in the order of tables: the baseline, the proposed method, the others as they come."""
    found = list(dict.fromkeys(rows["policy"])) if len(rows) else []
    first = [name for name in (BASELINE, PROPOSED) if name in found]
    return first + [name for name in found if name not in first]
