"""Numbers as text for tables and sentences; a dash stands for a missing number."""

from __future__ import annotations

import math
from collections.abc import Iterable

MISSING = "\u2013"
MINUS = "\u2212"


def percent(share: float | None) -> str:
    """Format a share: 0.9651 as "96.5 %"."""
    return _number(share, 100, ".1f", " %")


def points(difference: float | None) -> str:
    """Format a difference of shares in percentage points, with its sign."""
    return _number(difference, 100, "+.1f")


def ratio(value: float | None) -> str:
    """Format a ratio with three decimals."""
    return _number(value, 1, ".3f")


def interval(low: float, high: float, spec: str = ".1f") -> str:
    """Format the ends of an interval of shares in percent or, with a sign in ``spec``, in points."""
    return MISSING if math.isnan(low) else f"{_number(low, 100, spec)} to {_number(high, 100, spec)}"


def list_numbers(numbers: Iterable[int]) -> str:
    """List whole numbers: 3 to 9 with a dash where they are consecutive, else "3, 5, 8"."""
    values = sorted(set(map(int, numbers)))
    if len(values) > 2 and values[-1] - values[0] == len(values) - 1:
        return f"{values[0]}\u2013{values[-1]}"
    return ", ".join(map(str, values))


def ranges(numbers: Iterable[int]) -> str:
    """List whole numbers in sentences, runs of them by their ends: "0 to 4, 7, 8"."""
    runs: list[list[int]] = []
    for number in sorted(set(map(int, numbers))):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


def _number(value: float | None, factor: float, spec: str, unit: str = "") -> str:
    if value is None or math.isnan(value):
        return MISSING
    return format(factor * value, spec).replace("-", MINUS) + unit
