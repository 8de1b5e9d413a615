"""A person corrects a policy: it places, they take the lead when it goes wrong, and hand it back.

What they do is recorded as theirs (``Step.intervention``). The demonstrations then lie where the policy needed them, as
in DAgger with a person who decides when to help (HG-DAgger, Kelly et al. 2019); a later training keeps what the person
let pass and gives more weight to what they corrected (Mandlekar et al. 2020, intervention weighted regression).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

from layflat.data.types import Observation
from layflat.policy.base import Decision, Policy, PolicyError

ControlRequest: TypeAlias = Literal["lead", "hand back"]
REST_STEPS = 8
"""0.8 s: longer than a thumb rests between two moves of one correction."""


class Takeover:
    """Acts as ``policy`` until the person wants the lead, then as ``person`` until they hand it back.

    ``wish`` says what the person wants now, or None where they want nothing else than before; it is asked once a step
    and must not wait. A policy that gets the lead back goes on as after a disturbance: whatever it had counted towards
    its stop belongs to another state of the cloth.
    """

    def __init__(self, policy: Policy, person: Policy, wish: Callable[[], ControlRequest | None]) -> None:
        if policy.robot != person.robot:
            raise PolicyError(f"{policy.name} is for the {policy.robot} robot and {person.name} for {person.robot}")
        self.name = f"{policy.name}+{person.name}"
        self.robot = policy.robot
        self.led = False
        """Whether the person has the lead."""
        self._policy, self._person = policy, person
        self._wish = wish

    def reset(self, seed: int) -> None:
        self._policy.reset(seed)
        self._person.reset(seed)
        self.led = False

    def resume(self) -> None:
        self._policy.resume()
        self._person.resume()

    def act(self, observation: Observation) -> Decision:
        wish = self._wish()
        if self.led and wish == "hand back":
            self._policy.resume()
        self.led = wish == "lead" or (self.led and wish is None)
        if not self.led:
            return self._policy.act(observation)
        return replace(self._person.act(observation), intervention=True)


class MotionTakeoverTrigger:
    """A wish by the hands alone: who moves wants the lead, and hands it back after ``rest_steps`` steps at rest.

    ``moving`` says whether the person's hands ask for motion now.
    """

    def __init__(self, moving: Callable[[], bool], *, rest_steps: int = REST_STEPS) -> None:
        if rest_steps < 1:
            raise PolicyError(f"rest_steps is {rest_steps}; it must be at least 1")
        self._moving = moving
        self._rest_steps = rest_steps
        self._rested = 0

    def let_go(self) -> None:
        """As if the hands had rested long enough."""
        self._rested = self._rest_steps

    def __call__(self) -> ControlRequest | None:
        if self._moving():
            self._rested = 0
            return "lead"
        self._rested += 1
        return "hand back" if self._rested >= self._rest_steps else None
