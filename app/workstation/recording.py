"""Recording as a state machine: what the controls do, whoever has them, and what is said about it.

It knows no device, no window and no simulator: readings come in by ``hear``, episodes run behind the seam ``Take``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal, TypeAlias

from app.workstation.inputs.reading import Control, Reading
from app.workstation.take import Begin, Glance, Pulled
from data.recorder import SessionRecorder

State: TypeAlias = Literal["waiting", "countdown", "running", "paused", "finished", "over"]
"""waiting: for START, the next cloth hangs or is being hung. countdown: about to run. running: each ``tick`` simulates
one (the first one waits for the first motion, so that no demonstration begins with standing still). paused: by the
person, or because the device is gone. finished: the bench has stopped (tick limit, unstable cloth) and only the verdict
is missing. over: nothing more is recorded."""

COUNTDOWN_S = 3.0


class Recording:
    """Demonstrations of consecutive seeds into one session.

    >>> while recording.state != "over":
    ...     recording.hear(source.poll())
    ...     if not recording.tick():
    ...         time.sleep(0.01)
    """

    state: State
    seed: int
    """Of the demonstration that waits or runs."""
    glance: Glance
    """How it stands."""
    message: str
    """The last thing that was said, one sentence for a person."""
    counts: dict[str, int]
    """success, failure, partial, discarded: what came of the demonstrations of this recording."""

    def __init__(
        self,
        recorder: SessionRecorder,
        begin: Begin,
        *,
        seed: int = 0,
        episodes: int | None = None,
        disturbance: str = "none",
        countdown_s: float = COUNTDOWN_S,
        tell: Callable[[str], None] = print,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """``episodes``: over after so many have been kept as success or failure; None: until QUIT.

        ``tell`` gets the contract's lines (``kept demo_3 success 84 ticks contact 0.97 FILE.h5``, ``discarded ...``),
        each only when it is true. ``disturbance`` is what DISTURB begins.
        """
        raise NotImplementedError

    def hear(self, reading: Reading) -> None:
        """Take note of a reading: obey its controls, pause where the device has gone, go on when it is back."""
        raise NotImplementedError

    def handle(self, control: Control) -> None:
        """Obey one control; one that makes no sense now does nothing but say so."""
        raise NotImplementedError

    def does(self, control: Control) -> str | None:
        """What the control would do now, for a person; None where it would do nothing."""
        raise NotImplementedError

    def tick(self, pull: Pulled | None = None) -> bool:
        """One step of what the state asks; True where a tick was simulated. Never waits but for the simulation."""
        raise NotImplementedError

    def countdown_left_s(self) -> float:
        """Seconds until it runs; 0 in any other state."""
        raise NotImplementedError

    def close(self) -> None:
        """End it now: a demonstration that runs is kept as partial. May be called twice; called by QUIT."""
        raise NotImplementedError
