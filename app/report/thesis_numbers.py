"""Results that the thesis reports, each with the place where it stands; contact portions in 0..1.

Every number is from its text and tables: its figures have no axes to read more from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

BASELINE, PROPOSED = "gp-baseline", "gp-word"


@dataclass(frozen=True, kw_only=True)
class ReportedResult:
    """One number of the thesis."""

    value: float
    source: str


FLATTENING_START_MESH = ReportedResult(value=0.74, source="chapter 3-2-2, Figure 3-5")
"""Contact of the particles at the start, about."""
FLATTENING_START = ReportedResult(value=0.7434, source="chapter 3-2-2, Figure 3-6, frame 1")
FLATTENING: Mapping[str, ReportedResult] = {
    "word": ReportedResult(value=1.0, source="chapter 3-2-2, Figure 3-6, frame 10"),
    "stretch-right": ReportedResult(value=0.9267, source="chapter 3-2-2, Figure 3-7"),
    "random": ReportedResult(value=0.7333, source="chapter 3-2-2, Figure 3-8"),
}
"""Final contact portion of each controller, one run each."""

PLACING_SIMULATED: Mapping[str, ReportedResult] = {
    BASELINE: ReportedResult(value=1.0, source="chapter 4-2-2, Figure 4-2, frame 10"),
    PROPOSED: ReportedResult(value=1.0, source="chapter 4-2-2, Figure 4-3, frame 10"),
}
"""Final contact portion in SoftGym, one run each; above 0.9 in frame 8 of both."""

PLACING: Mapping[str, tuple[float, float, float]] = {
    BASELINE: (0.9909, 0.9662, 0.9448),
    PROPOSED: (0.9830, 0.9651, 0.9146),
}
"""Table 4-1, robot: largest, mean and least final contact portion."""
PLACING_SOURCE = "Table 4-1"

DISTURBANCE: Mapping[str, tuple[tuple[float, float, float], ...]] = {
    BASELINE: ((0.9526, 0.9141, 0.9125), (0.9633, 0.8937, 0.8983), (0.9909, 0.9004, 0.9024)),
    PROPOSED: ((0.9623, 0.8390, 0.9253), (0.9830, 0.9055, 0.9532), (0.9660, 0.7827, 0.8899)),
}
"""Table 4-2, robot: contact portion after placing, after the disturbance, and final; three experiments each."""
DISTURBANCE_SOURCE = "Table 4-2"
REGAINED_CLAIM: Mapping[str, str] = {BASELINE: "less than 1 point", PROPOSED: "around 5 to 10 points"}
"""Chapter 4-3-3, in words."""

BAD_CONTACT = ReportedResult(value=0.7939, source="chapter 5-1, Figure 5-1")
"""Final contact after a bad first contact."""
FOLDED_CORNER = "the robot pulls, and stops with the corner still folded (no number)"
"""Chapter 5-1, Figure 5-2."""


def regained(policy: str) -> tuple[float, ...]:
    """Return final contact less that after the disturbance, of the three experiments of Table 4-2."""
    return tuple(final - disturbed for _, disturbed, final in DISTURBANCE[policy])
