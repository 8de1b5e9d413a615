"""TakeoverPolicy: a person takes control from a policy when it goes wrong, corrects it and releases control again.

The person's steps are recorded as interventions. The demonstrations then lie where the policy needed them (HG-DAgger,
Kelly et al. 2019); a training may weight them (intervention weighted regression, Mandlekar et al. 2020).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

from layflat.data.types import Observation
from layflat.policy.base import Decision, Policy, PolicyError, continue_after_disturbance

ControlRequest: TypeAlias = Literal["take", "release"]
"""Request of a person to take control from the policy or to release it."""
REST_STEPS = 8
"""0.8 s: longer than a thumb rests between two moves of one correction."""


class TakeoverPolicy:
    """Acts as ``policy`` until the person takes control, then as ``person`` until they release it.

    ``request`` returns the person's request, or None if nothing changes; it is called once a step and must not wait.
    After a release the policy continues as after a disturbance: its stop rules counted another state of the cloth.
    """

    def __init__(self, policy: Policy, person: Policy, request: Callable[[], ControlRequest | None]) -> None:
        if policy.robot != person.robot:
            raise PolicyError(f"{policy.name} is for robot {policy.robot}, but {person.name} is for {person.robot}")
        self.name, self.robot = f"{policy.name}+{person.name}", policy.robot
        self.human_in_control = False
        self._policy, self._person, self._request = policy, person, request

    def reset(self, seed: int) -> None:
        """Start a new episode with the policy in control."""
        self._policy.reset(seed)
        self._person.reset(seed)
        self.human_in_control = False

    def continue_after_disturbance(self) -> None:
        """Prepare both to continue; control does not change."""
        continue_after_disturbance(self._policy)
        continue_after_disturbance(self._person)

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        request = self._request()
        if self.human_in_control and request == "release":
            continue_after_disturbance(self._policy)
        self.human_in_control = request == "take" or (self.human_in_control and request is None)
        if not self.human_in_control:
            return self._policy.act(observation)
        return replace(self._person.act(observation), intervention=True)


class MotionTakeoverTrigger:
    """Takes control as soon as the hands move, and releases it after ``rest_steps`` steps at rest.

    ``moving`` returns whether the person's hands ask for motion now.
    """

    def __init__(self, moving: Callable[[], bool], *, rest_steps: int = REST_STEPS) -> None:
        if rest_steps < 1:
            raise PolicyError(f"rest_steps is {rest_steps}; it must be at least 1")
        self._moving, self._rest_steps, self._rested = moving, rest_steps, 0

    def release(self) -> None:
        """Release control now, as if the hands had rested long enough."""
        self._rested = self._rest_steps

    def __call__(self) -> ControlRequest | None:
        """Return the request of this step."""
        if self._moving():
            self._rested = 0
            return "take"
        self._rested += 1
        return "release" if self._rested >= self._rest_steps else None
