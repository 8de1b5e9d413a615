"""Input of a person at one moment: motion and commands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.errors import DataError
from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, frozen_hand


class Command(Enum):
    """Request of a button; its effect depends on the state, see `SessionStatus.effects`."""

    START = "start"
    """Start the next demonstration after a countdown, or continue a paused one."""
    PAUSE = "pause"
    """Stop simulated time, or continue."""
    KEEP_SUCCESS = "keep as success"
    KEEP_FAILURE = "keep as failure"
    DISCARD = "discard"
    """Discard this demonstration and go to the next seed."""
    REDO = "redo"
    """Discard this demonstration and start the same seed again."""
    QUIT = "quit"
    """End the recording; a running demonstration is kept as partial."""
    UNDO = "undo"
    """Bring back the demonstration that was discarded last, until the next one begins."""
    DISTURB = "disturb"
    """Start the chosen disturbance while the person continues."""


@dataclass(frozen=True, kw_only=True)
class TeleopInput:
    """Newest state of a teleoperator, and the commands since the last poll."""

    motion: FloatArray
    """(A,) in [-1, 1], in the order of the robot's axes: share of the speed along each axis."""
    speed: float = 1.0
    """Share of ACTION_LIMIT_M that a full deflection moves in one step, 0..1."""
    commands: tuple[Command, ...] = ()
    """Commands in the order in which they were given."""
    connected: bool = True
    """False: there is no device; a recording pauses until there is one."""
    device: str = ""
    """Name of the device, for a person."""
    problem: str = ""
    """One sentence about what is wrong and what to do, or empty."""
    stamp_s: float = 0.0
    """Time of the reading by the system's monotonic clock; 0 where it is not measured."""
    hand: FloatArray | None = None
    """Place to which a guiding hand draws the robot: (3,), or (2, 3) for two points; m, world."""

    def __post_init__(self) -> None:
        motion = frozen_array(self.motion, (None,), "motion")
        if np.abs(motion).max(initial=0.0) > 1.0:
            raise DataError(f"motion is {motion.tolist()}; each number must be within -1..1")
        if not 0.0 <= self.speed <= 1.0:
            raise DataError(f"speed is {self.speed}; it must be within 0..1")
        object.__setattr__(self, "motion", motion)
        if self.hand is not None:
            object.__setattr__(self, "hand", frozen_hand(self.hand))

    @property
    def action(self) -> FloatArray:
        """Displacement of one step, (A,) m."""
        return self.motion * (self.speed * ACTION_LIMIT_M)

    @property
    def moving(self) -> bool:
        """Whether the person asks for any motion."""
        return self.hand is not None or bool(np.any(self.motion) and self.speed > 0)

    def without_commands(self) -> TeleopInput:
        """Return the same motion without its commands: each is handled once."""
        return replace(self, commands=())


def zero_input(robot: RobotSpec, *, connected: bool = True, device: str = "", problem: str = "") -> TeleopInput:
    """Return an input without motion and commands."""
    return TeleopInput(motion=robot.zeros(), connected=connected, device=device, problem=problem)
