"""Newest input of a person, from the window to the activity's process.

Commands are not here: each must arrive, so they are sent through a connection, while only the newest motion matters.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from multiprocessing.context import BaseContext

import numpy as np

from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget

_DTYPE = np.dtype(
    [
        ("stamp_s", "f8"), ("motion", "f8", 6), ("speed", "f8"), ("connected", "?"), ("device", "U80"),
        ("problem", "U240"), ("n_hands", "i4"), ("hand", "f8", (2, 3)), ("node", "i4"), ("target", "f8", 3),
    ]
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class InputSample:
    """One value of the channel."""

    stamp_s: float
    """Time of writing by the system's monotonic clock, which all processes share."""
    teleop: TeleopInput
    drag: DragTarget | None = None


class InputChannel:
    """The window writes, the activity's process reads."""

    def __init__(self, context: BaseContext, robot: RobotSpec) -> None:
        self._value = LatestValue(context, _DTYPE)
        self.robot: RobotSpec = robot

    def write(self, teleop: TeleopInput, drag: DragTarget | None = None) -> float:
        """Replace the value; return its stamp."""
        stamp_s = time.monotonic()
        motion = np.zeros(6)
        motion[: len(teleop.motion)] = teleop.motion
        hand = np.zeros((2, 3))
        n_hands = 0 if teleop.hand is None else int(np.ndim(teleop.hand))
        if teleop.hand is not None:
            hand[:n_hands] = teleop.hand
        self._value.write(
            stamp_s=stamp_s,
            motion=motion,
            speed=teleop.speed,
            connected=teleop.connected,
            device=teleop.device[:80],
            problem=teleop.problem[:240],
            n_hands=n_hands,
            hand=hand,
            node=-1 if drag is None else drag.node,
            target=np.zeros(3) if drag is None else drag.target_m,
        )
        return stamp_s

    def read(self) -> InputSample | None:
        """Return the newest value, or None before the first one."""
        found = self._value.read()
        if found is None:
            return None
        _, value = found
        n_hands, node = int(value["n_hands"]), int(value["node"])
        teleop = TeleopInput(
            motion=value["motion"][: self.robot.size],
            speed=float(value["speed"]),
            connected=bool(value["connected"]),
            device=str(value["device"]),
            problem=str(value["problem"]),
            stamp_s=float(value["stamp_s"]),
            hand=None if n_hands == 0 else value["hand"][0] if n_hands == 1 else value["hand"],
        )
        drag = None if node < 0 else DragTarget(node=node, target_m=value["target"].copy())
        return InputSample(stamp_s=teleop.stamp_s, teleop=teleop, drag=drag)
