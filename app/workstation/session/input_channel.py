"""Newest input of a person, from the window to the activity's process.

Commands are not here: each must arrive, so they are sent through a connection, while only the newest motion matters.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from multiprocessing.context import BaseContext

import numpy as np

from layflat.app.workstation.session.latest_value import LatestJson
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.types import DragTarget

MAX_BYTES = 4000
MAX_CHARS = 240
"""Longest name and problem of a device."""


@dataclass(frozen=True, kw_only=True)
class InputSample:
    """One value of the channel."""

    stamp_s: float
    """Time of writing by the system's monotonic clock, which all processes share."""
    teleop: TeleopInput
    drag: DragTarget | None = None


class InputChannel:
    """The window writes, the activity's process reads."""

    def __init__(self, context: BaseContext) -> None:
        self._value = LatestJson(context, MAX_BYTES)

    def write(self, teleop: TeleopInput, drag: DragTarget | None = None) -> float:
        """Replace the value; return its stamp."""
        stamp_s = time.monotonic()
        fields = {
            "motion": teleop.motion.tolist(),
            "speed": teleop.speed,
            "connected": teleop.connected,
            "device": teleop.device[:MAX_CHARS],
            "problem": teleop.problem[:MAX_CHARS],
            "stamp_s": stamp_s,
            "hand": None if teleop.hand is None else teleop.hand.tolist(),
        }
        self._value.write({"teleop": fields, "drag": None if drag is None else [drag.node, drag.target_m.tolist()]})
        return stamp_s

    def read(self) -> InputSample | None:
        """Return the newest value, or None before the first one."""
        found = self._value.read()
        if found is None:
            return None
        fields, drag = found[1]["teleop"], found[1]["drag"]
        arrays = {name: None if fields[name] is None else np.array(fields[name]) for name in ("motion", "hand")}
        return InputSample(
            stamp_s=fields["stamp_s"],
            teleop=TeleopInput(**(fields | arrays)),
            drag=None if drag is None else DragTarget(node=drag[0], target_m=drag[1]),
        )
