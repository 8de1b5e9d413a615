"""CheckedPolicy: a policy from outside, whose every answer is checked before the robot gets it."""

from __future__ import annotations

from typing import Any

import numpy as np

from layflat.data.errors import DataError
from layflat.data.robot import RobotSpec
from layflat.data.types import Observation
from layflat.policy.base import Decision, PolicyError, continue_after_disturbance, max_extra_steps
from layflat.policy.runner import as_decision


class CheckedPolicy:
    """Calls a policy of somebody's own; what it raises or answers wrongly is a PolicyError of one sentence.

    Its attributes ``robot`` and ``name`` are not needed: the environment and the command line know both.
    """

    def __init__(self, policy: Any, *, name: str, robot: RobotSpec) -> None:
        """Check that it is a policy, and for this robot."""
        self.name, self.robot, self._policy, self._n_steps = name, robot, policy, 0
        for method in ("reset", "act"):
            if not callable(getattr(policy, method, None)):
                raise PolicyError(f"{name} is no policy: a {type(policy).__name__} has no method {method}")
        own = getattr(policy, "robot", robot)
        if getattr(own, "name", own) != robot.name:
            raise PolicyError(f"{name} is for robot {own}, not {robot}")
        self.max_extra_steps = max_extra_steps(policy)

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        self._n_steps = 0
        self._call(self._policy.reset, seed)

    def continue_after_disturbance(self) -> None:
        """Tell the policy that the episode continues."""
        self._call(continue_after_disturbance, self._policy)

    def act(self, observation: Observation) -> Decision:
        """Decide one step; PolicyError where the answer is no action of this robot."""
        answer = self._call(self._policy.act, observation)
        self._n_steps += 1
        if not isinstance(answer, Decision):
            try:
                values = np.asarray(answer, dtype=float)
            except (TypeError, ValueError) as error:
                raise self._wrong(f"a {type(answer).__name__}") from error
            if values.shape != (self.robot.size,):
                raise self._wrong(f"an array of shape {values.shape}")
            if not np.isfinite(values).all():
                raise self._wrong(str(values.tolist()))
            answer = as_decision(values)
        if answer.action.shape != (self.robot.size,):
            raise self._wrong(f"an action of shape {answer.action.shape}")
        return answer

    def _wrong(self, what: str) -> PolicyError:
        axes = ", ".join(self.robot.action_names)
        return PolicyError(
            f"{self.name} answered {what} in step {self._n_steps}; an action has {self.robot.size} finite numbers "
            f"({axes}), in metres"
        )

    def _call(self, function: Any, *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except (PolicyError, DataError) as error:
            raise PolicyError(f"{self.name}: {error}") from error
        except Exception as error:
            raise PolicyError(
                f"{self.name} failed in step {self._n_steps + 1} by {type(error).__name__}: {one_line(error)}"
            ) from error


def one_line(error: BaseException) -> str:
    """Return an exception's text on one line, shortened."""
    text = " ".join(str(error).split())
    return text if len(text) <= 200 else f"{text[:200]}..."
