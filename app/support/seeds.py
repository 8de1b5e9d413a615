"""Seeds of what tries a policy, and what to say where it was taught the same ones."""

from __future__ import annotations

from collections.abc import Collection

from layflat.app.support.formatting import ranges

EVALUATION_SEED = 10_000
"""Default first seed of what tries a policy: demonstrations begin at 0, those of a demo or reproduction at 1000."""


def taught_text(policy: str, seeds: Collection[int]) -> str:
    """Return what to say where a policy is tried on the starts that it was taught."""
    return (
        f"{policy} was taught on seed{'s' * (len(seeds) > 1)} {ranges(seeds)} and knows these starts;"
        f" others, such as --seed {EVALUATION_SEED}, show what it has learned"
    )
