"""Policy and Decision: the interface between a policy and everything that runs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.robot import RobotSpec
from layflat.data.types import Observation, StoppedBy, frozen_hand


class PolicyError(ValueError):
    """Base of the errors that the policy package raises."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Decision of a policy for one step; arrays are checked and read-only.

    Parameters
    ----------
    action : array_like of shape (A,)
        Displacement in this step, m, world axes, in the order of the robot's action axes.
    std : array_like of shape (A,), optional
        Standard deviation of the action, m.
    stop : StoppedBy, optional
        Why the policy has finished. If given, the action is not carried out.
    reason : str
        Short explanation for people, such as ``"descending"``.
    hand : array_like of shape (3,) or (2, 3), optional
        Position of a person's guiding hand, m, world; one row per point for a robot with two points. The robot yields
        to the hand, and its resulting motion is recorded instead of ``action``.
    intervention : bool
        Whether a person decided although a policy is in control of the episode.

    Raises
    ------
    DataError
        If an array has the wrong shape or holds a value that is not finite.
    """

    action: FloatArray
    std: FloatArray | None = None
    stop: StoppedBy | None = None
    reason: str = ""
    hand: FloatArray | None = None
    intervention: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "action", frozen_array(self.action, (None,), "action"))
        if self.hand is not None:
            object.__setattr__(self, "hand", frozen_hand(self.hand))
        if self.std is not None:
            object.__setattr__(self, "std", frozen_array(self.std, self.action.shape, "std"))


@runtime_checkable
class Policy(Protocol):
    """Chooses the robot's displacement from the observation.

    Two members are optional: a method ``continue_after_disturbance()``, called when an episode continues after a stop,
    and an attribute ``max_extra_steps``. Use the functions of the same names in this module to call or read them.

    Attributes
    ----------
    name : str
        Name in tables and files, such as ``scripted`` or ``gp-word``.
    robot : RobotSpec
        Robot that the policy moves.
    """

    name: str
    robot: RobotSpec

    def reset(self, seed: int) -> None:
        """Start a new episode.

        Parameters
        ----------
        seed : int
            Seed of all random choices of the policy in this episode.
        """

    def act(self, observation: Observation) -> Decision:
        """Decide one step.

        Parameters
        ----------
        observation : Observation
            Observation at the start of the step.

        Returns
        -------
        Decision
            The action, or why the policy stops.
        """


def continue_after_disturbance(policy: Policy) -> None:
    """Prepare a policy that has such a method to continue after a stop: it restarts its stop rules, no more."""
    prepare = getattr(policy, "continue_after_disturbance", None)
    if prepare is not None:
        prepare()


def max_extra_steps(policy: Policy) -> int:
    """Return how many steps more than the usual limit a policy may need; 0 unless it has an attribute of this name."""
    return int(getattr(policy, "max_extra_steps", 0))
