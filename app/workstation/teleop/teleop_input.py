"""What a person's hands say at one moment."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.errors import DataError
from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, frozen_hand


class Command(Enum):
    """What a button can ask of a recording; what it does depends on the state, see ``Recording.does``."""

    START = "start"
    """Begin the next demonstration (after a countdown); where one is paused, go on."""
    PAUSE = "pause"
    """Stop simulated time; the same again goes on."""
    KEEP_SUCCESS = "keep as success"
    KEEP_FAILURE = "keep as failure"
    DISCARD = "discard"
    """Forget this demonstration and turn to the next seed."""
    REDO = "redo"
    """Forget this demonstration and begin the same seed again."""
    QUIT = "quit"
    """End the recording; a demonstration that is running is kept as partial."""
    DISTURB = "disturb"
    """Begin the disturbance that was chosen, while the person goes on."""


@dataclass(frozen=True, kw_only=True)
class TeleopInput:
    """The newest state of a source, and the controls since it was last asked."""

    motion: FloatArray
    """(A,) in [-1, 1], in the order of the robot's axes: share of the speed along each axis."""
    speed: float = 1.0
    """0..1: share of ACTION_LIMIT_M that a full deflection moves in one step."""
    controls: tuple[Command, ...] = ()
    """In the order in which they came."""
    connected: bool = True
    """False: there is no device; a recording pauses until there is one."""
    device: str = ""
    """Its name, for a person."""
    problem: str = ""
    """One sentence where something is wrong, what to do about it included."""
    stamp_s: float = 0.0
    """When it was read, by the system's monotonic clock; 0 where nobody asks."""
    hand: FloatArray | None = None
    """Kinesthetic teaching: where the hand draws the holder, (3,) or for two pickers (2, 3) m, world."""

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
        """(A,) m: the displacement of one step."""
        return self.motion * (self.speed * ACTION_LIMIT_M)

    @property
    def moving(self) -> bool:
        """Whether the hands ask for any motion."""
        return self.hand is not None or bool(np.any(self.motion) and self.speed > 0)

    def after(self, earlier: TeleopInput) -> TeleopInput:
        """This reading where ``earlier`` was never looked at: the newest motion, the controls of both in order."""
        return replace(self, controls=(*earlier.controls, *self.controls))

    def heard(self) -> TeleopInput:
        """The same without its controls: each is obeyed once."""
        return replace(self, controls=())


def zero_input(robot: RobotSpec, *, connected: bool = True, device: str = "", problem: str = "") -> TeleopInput:
    """No motion, no controls."""
    return TeleopInput(motion=robot.zeros(), connected=connected, device=device, problem=problem)
