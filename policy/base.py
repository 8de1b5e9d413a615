"""The seam between who decides and the rest: a person, the scripted expert and a learned GP are one type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.robot import RobotSpec
from layflat.data.types import Observation, StoppedBy, frozen_hand


class PolicyError(ValueError):
    """Base of what the policy package raises."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What to do in one step."""

    action: FloatArray
    """(A,) m per step, world axes, in the order of the robot's axes."""
    std: FloatArray | None = None
    """(A,) m, standard deviation of the action where the policy knows one."""
    stop: StoppedBy | None = None
    """Not None: the policy has finished and says why; the action is not carried out."""
    reason: str = ""
    """One clause for a person: "descending", "output below 2 mm for 8 steps", ..."""
    hand: FloatArray | None = None
    """(3,) m, or (2, 3) m for two pickers: kinesthetic teaching. Where a person's hand draws the holder, which gives
    way; what the holder then does is recorded instead of ``action``."""
    intervention: bool = False
    """A person decided although a policy has the lead."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "action", frozen_array(self.action, (None,), "action"))
        if self.hand is not None:
            object.__setattr__(self, "hand", frozen_hand(self.hand))
        if self.std is not None:
            object.__setattr__(self, "std", frozen_array(self.std, self.action.shape, "std"))


@runtime_checkable
class Policy(Protocol):
    """Chooses a displacement from what it sees."""

    name: str
    """As in tables and files: scripted, gp-word, gp-baseline, drag-rule, ..."""
    robot: RobotSpec

    def reset(self, seed: int) -> None:
        """Forget the last episode."""

    def resume(self) -> None:
        """Go on after a stop (a disturbance came): forget the stop counter, keep the rest."""

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""


def extra_steps(policy: Policy) -> int:
    """How many steps more than usual it may need until it stops: the attribute of that name where it has one."""
    return int(getattr(policy, "extra_steps", 0))
