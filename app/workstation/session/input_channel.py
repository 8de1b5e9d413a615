"""What a person's hands do now, from the window to the bench: the newest counts, and a stamp says when that was.

Buttons are not here: each must arrive, so they are sent (``link.py``), while motion is only ever wanted as it is now.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from multiprocessing.context import BaseContext

import numpy as np

from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.teleop import TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget

_DTYPE = np.dtype(
    [
        ("stamp_s", "f8"), ("motion", "f8", 6), ("speed", "f8"), ("connected", "?"), ("device", "U80"),
        ("problem", "U240"), ("hands", "i4"), ("hand", "f8", (2, 3)), ("node", "i4"), ("target", "f8", 3),
    ]
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class InputSample:
    """One value of the mailbox."""

    stamp_s: float
    """When it was put in, by the system's monotonic clock, which all processes share."""
    reading: TeleopInput
    pull: DragTarget | None = None
    number: int = field(default=0, compare=False)


class InputChannel:
    """The window puts in, the bench looks."""

    def __init__(self, context: BaseContext, robot: RobotSpec) -> None:
        self._value = LatestValue(context, _DTYPE)
        self._robot: RobotSpec = robot

    def put(self, reading: TeleopInput, pull: DragTarget | None = None) -> float:
        """Replace what was there; returns the stamp."""
        stamp_s = time.monotonic()
        motion = np.zeros(6)
        motion[: len(reading.motion)] = reading.motion
        hand = np.zeros((2, 3))
        hands = 0 if reading.hand is None else int(np.ndim(reading.hand))
        if reading.hand is not None:
            hand[:hands] = reading.hand
        self._value.write(
            stamp_s=stamp_s,
            motion=motion,
            speed=reading.speed,
            connected=reading.connected,
            device=reading.device[:80],
            problem=reading.problem[:240],
            hands=hands,
            hand=hand,
            node=-1 if pull is None else pull.node,
            target=np.zeros(3) if pull is None else pull.target_m,
        )
        return stamp_s

    def look(self) -> InputSample | None:
        """What is in it now; None before anything was put in."""
        found = self._value.read()
        if found is None:
            return None
        number, value = found
        hands = int(value["hands"])
        hand = None if hands == 0 else value["hand"][0] if hands == 1 else value["hand"]
        reading = TeleopInput(
            motion=value["motion"][: self._robot.size],
            speed=float(value["speed"]),
            connected=bool(value["connected"]),
            device=str(value["device"]),
            problem=str(value["problem"]),
            stamp_s=float(value["stamp_s"]),
            hand=hand,
        )
        node = int(value["node"])
        pull = None if node < 0 else DragTarget(node=node, target_m=value["target"].copy())
        return InputSample(stamp_s=float(value["stamp_s"]), reading=reading, pull=pull, number=number)
