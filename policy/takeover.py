"""A person corrects a policy: it places, they take the lead when it goes wrong, and hand it back.

What they do is recorded as theirs (``Step.intervention``), so that a later training can give it more weight: the
demonstrations then lie where the policy needed them, as in DAgger with a person who decides when to help (HG-DAgger,
Kelly et al. 2019).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

from data.types import Observation
from policy.base import Decision, Policy, PolicyError

Wish: TypeAlias = Literal["lead", "hand back"]


class Takeover:
    """Acts as ``policy`` until the person wants the lead, then as ``person`` until they hand it back.

    ``wish`` says what the person wants now, or None where they want nothing else than before; it is asked once a tick
    and must not wait. A policy that gets the lead back goes on as after a disturbance: whatever it had counted towards
    its stop belongs to another state of the cloth.
    """

    def __init__(self, policy: Policy, person: Policy, wish: Callable[[], Wish | None]) -> None:
        if policy.task != person.task:
            raise PolicyError(f"{policy.name} is for the {policy.task} task and {person.name} for {person.task}")
        self.name = f"{policy.name}+{person.name}"
        self.task = policy.task
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
