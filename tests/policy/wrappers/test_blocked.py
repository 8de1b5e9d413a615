"""UnblockingPolicy: acts only on a holder that is stuck."""

from __future__ import annotations

import numpy as np

from layflat.policy.base import Decision
from layflat.policy.wrappers.blocked import BLOCKED_STEPS, LAID_M, MOVES_M, TRIES, UnblockingPolicy
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import observe


class Down:
    """Always lowers the cloth by ``step_m``."""

    name, robot = "down", HANGER

    def __init__(self, step_m: float = 0.008) -> None:
        self.step_m = step_m

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation):
        return Decision(action=np.array([0.0, -self.step_m]), reason="down")


def run(policy, heights):
    policy.reset(0)
    return [policy.act(observe(0.1, z)).reason for z in heights]


def test_a_holder_that_moves_or_rests_on_purpose_is_left_alone():
    assert set(run(UnblockingPolicy(Down()), 0.3 - 0.002 * np.arange(60))) == {"down"}
    assert set(run(UnblockingPolicy(Down(0.001)), np.full(60, 0.1))) == {"down"}


def test_a_holder_that_lies_on_the_table_is_at_the_border_of_the_workspace():
    """Raised there, it folds the cloth: seed 4100 of the demonstrator ended at 0.53 instead of 0.84."""
    assert set(run(UnblockingPolicy(Down()), np.full(60, LAID_M - 0.005))) == {"down"}


def test_a_stuck_holder_rises_and_goes_forward_and_then_the_policy_continues():
    reasons = run(UnblockingPolicy(Down()), np.full(BLOCKED_STEPS + 1 + len(MOVES_M), 0.1))
    assert reasons == ["down"] * BLOCKED_STEPS + ["freeing the held edge"] * len(MOVES_M) + ["down"]
    assert MOVES_M[0][1] > 0 == MOVES_M[0][0]
    assert MOVES_M[-1][0] > 0


def test_it_gives_up_in_the_end_and_may_try_again_after_a_disturbance():
    policy = UnblockingPolicy(Down())
    wanted = TRIES * len(MOVES_M)
    assert run(policy, np.full(200, 0.1)).count("freeing the held edge") == wanted
    assert policy.max_extra_steps == 0
    policy.continue_after_disturbance()
    again = [policy.act(observe(0.1, 0.1)).reason for _ in range(200)]
    assert again.count("freeing the held edge") == wanted
