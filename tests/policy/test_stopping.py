from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.data.types import STOP_REASONS
from layflat.policy.base import PolicyError
from layflat.policy.stopping import (
    AnyOf,
    BelowThreshold,
    ContactReached,
    NoContactGain,
    StopRule,
    Stuck,
    XLimit,
)

lengths = st.lists(st.floats(0, 0.01), max_size=40)


def fires(rule: StopRule, observations, actions) -> list[bool]:
    return [rule.update(o, np.array([a, 0.0])) is not None for o, a in zip(observations, actions, strict=True)]


@given(norms=lengths, n_steps=st.integers(1, 10))
def test_below_threshold_fires_exactly_when_the_last_steps_were_all_low(observe, norms, n_steps):
    fired = fires(BelowThreshold(threshold_m=0.002, n_steps=n_steps), len(norms) * [observe()], norms)
    expected = [k + 1 >= n_steps and max(norms[k + 1 - n_steps : k + 1]) < 0.002 for k in range(len(norms))]
    assert fired == expected


@given(norms=lengths)
def test_a_larger_threshold_never_stops_later(observe, norms):
    seen = len(norms) * [observe()]
    small = fires(BelowThreshold(threshold_m=0.002, n_steps=3), seen, norms)
    large = fires(BelowThreshold(threshold_m=0.004, n_steps=3), seen, norms)
    assert all(b or not a for a, b in zip(small, large, strict=True))


def test_threshold_looks_at_the_norm_not_at_one_axis(observe):
    rule = BelowThreshold(threshold_m=0.002)
    assert rule.update(observe(), np.full(6, 0.0015)) is None
    assert rule.update(observe(), np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.0015])) is not None


@given(st.lists(st.floats(0, 1), min_size=1, max_size=40), st.integers(1, 8))
def test_no_gain_needs_that_many_steps_without_a_new_best(observe, contacts, n_steps):
    fired = fires(
        NoContactGain(n_steps=n_steps, gain=0.01), [observe(contact=c) for c in contacts], np.ones(len(contacts))
    )
    assert not any(fired[:n_steps])
    for k in np.flatnonzero(fired):
        assert max(contacts[k - n_steps + 1 : k + 1]) < max(contacts[: k - n_steps + 1]) + 0.01


def test_steady_gain_never_stops_and_standstill_does(observe):
    rising = [observe(contact=0.02 * k) for k in range(50)]
    assert not any(fires(NoContactGain(n_steps=3), rising, np.ones(50)))
    assert fires(NoContactGain(n_steps=3), 5 * [observe(contact=0.5)], np.ones(5)) == [False, False, False, True, True]


def test_a_cloth_in_the_air_is_not_given_up(observe):
    rule = NoContactGain(n_steps=3, from_contact=0.5)
    assert not any(fires(rule, 30 * [observe(contact=0.0)], np.ones(30)))
    assert any(fires(rule, 6 * [observe(contact=0.6)], np.ones(6)))


def test_contact_drop_after_reset_counts_as_a_new_start(observe):
    rule = NoContactGain(n_steps=2)
    fires(rule, 5 * [observe(contact=1.0)], np.ones(5))
    rule.reset()
    repairing = [observe(contact=c) for c in (0.85, 0.87, 0.9, 0.93)]
    assert not any(fires(rule, repairing, np.ones(4)))


def test_contact_reached_and_x_limit(observe):
    assert fires(ContactReached(0.9), [observe(contact=c) for c in (0.89, 0.9, 1.0)], np.ones(3)) == [False, True, True]
    assert fires(XLimit(0.5), [observe(x) for x in (0.49, 0.5, 0.6)], np.ones(3)) == [False, True, True]


def test_stuck_is_who_goes_nowhere_however_long_the_moves_that_were_asked_for(observe):
    rule = Stuck(n_steps=3, within_m=0.02)
    places = (0.1, 0.2, 0.21, 0.215, 0.2, 0.3, 0.3, 0.319)
    expected = [False, False, False, True, True, False, False, True]
    assert fires(rule, [observe(x) for x in places], np.full(8, 0.01)) == expected
    rule.reset()
    assert fires(rule, [observe(0.3)] * 3, np.full(3, 0.01)) == [False, False, True]


def test_contact_may_have_to_last(observe):
    rule = ContactReached(0.9, n_steps=2)
    seen = [observe(contact=c) for c in (0.95, 0.8, 0.95, 0.95, 0.95, 0.8, 0.95)]
    assert fires(rule, seen, np.ones(7)) == [False, False, False, True, True, False, False]
    rule.reset()
    assert fires(rule, seen[2:4], np.ones(2)) == [False, True]


def test_any_tells_every_rule_of_every_step(observe):
    """Also the rules behind the one that fires: else their counts would lag."""
    rule = AnyOf(ContactReached(0.9), BelowThreshold(threshold_m=9.0, n_steps=3))
    stops = [rule.update(observe(contact=c), np.ones(2)) for c in (0.95, 0.95, 0.0)]
    assert [stop.by if stop else None for stop in stops] == ["converged", "converged", "threshold"]


def test_any_of_nothing_never_stops(observe):
    assert AnyOf().update(observe(contact=1.0), np.zeros(2)) is None


def test_every_rule_uses_words_that_files_know(observe):
    rules = [
        BelowThreshold(threshold_m=1.0),
        Stuck(n_steps=1, within_m=1.0),
        NoContactGain(n_steps=1),
        ContactReached(0.1),
        XLimit(0.1),
    ]
    for rule in rules:
        rule.reset()
        stops = [rule.update(observe(0.5, contact=0.5), np.zeros(2)) for _ in range(2)]
        assert stops[-1] is not None
        assert stops[-1].by in STOP_REASONS
        assert stops[-1].reason


@pytest.mark.parametrize(
    "make",
    [
        lambda: BelowThreshold(threshold_m=0.0),
        lambda: BelowThreshold(threshold_m=0.1, n_steps=0),
        lambda: Stuck(n_steps=0, within_m=0.1),
        lambda: NoContactGain(n_steps=1, gain=float("nan")),
    ],
)
def test_impossible_rules_are_refused(make):
    with pytest.raises(PolicyError, match="must be"):
        make()
