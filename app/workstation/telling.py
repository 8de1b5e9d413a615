"""A take's process tells the window of its bench after each tick."""

from __future__ import annotations

import time

from app.run import Run
from app.workstation.inputs.reading import Reading
from app.workstation.moment import MomentBuffer


class Telling:
    """What a take is attended by (``take_process.Attend``)."""

    def __init__(self, moments: MomentBuffer) -> None:
        self._moments = moments
        self._told_s = 0.0

    def __call__(self, run: Run, reading: Reading) -> None:
        now = time.monotonic()
        self._moments.tell(
            run.bench,
            run.seen,
            run.truth,
            episode=_number_of(run),
            tick=run.ticks,
            phase=run.steps[-1].phase if run.steps else "place",
            input_s=reading.stamp_s if run.steps else 0.0,
            work_s=now - reading.stamp_s if reading.stamp_s else 0.0,
        )


def _number_of(run: Run) -> int:
    """Another number for each take: all of a process begin at different times."""
    return int(1000 * run.began_s) % 2**31
