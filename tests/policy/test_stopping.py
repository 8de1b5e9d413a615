from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from layflat.data.types import STOP_REASONS
from layflat.policy.stopping import AnyOf, NoContactGain, StopRule, Stuck, below_threshold, contact_reached, x_limit
from layflat.tests.policy.factories import observe

norms = st.lists(st.floats(0, 0.01), max_size=40)
T, F = True, False


def fires(rule: StopRule, observations, norms=None) -> list[bool]:
    norms = np.ones(len(observations)) if norms is None else norms
    return [rule.update(o, np.array([n, 0.0])) is not None for o, n in zip(observations, norms, strict=True)]


def contacts(*values: float):
    return [observe(contact=value) for value in values]


@given(norms=norms, n_steps=st.integers(1, 10))
def test_threshold_fires_exactly_when_the_last_steps_were_all_low(norms, n_steps):
    fired = fires(below_threshold(0.002, n_steps=n_steps), len(norms) * [observe()], norms)
    assert fired == [k + 1 >= n_steps and max(norms[k + 1 - n_steps : k + 1]) < 0.002 for k in range(len(norms))]


@given(norms=norms)
def test_a_larger_threshold_never_stops_later(norms):
    small, large = (fires(below_threshold(m, n_steps=3), len(norms) * [observe()], norms) for m in (0.002, 0.004))
    assert all(b or not a for a, b in zip(small, large, strict=True))


def test_threshold_compares_the_norm_not_one_axis():
    rule = below_threshold(0.002)
    assert rule.update(observe(), np.full(6, 0.0015)) is None
    assert rule.update(observe(), np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.0015])) is not None


@given(st.lists(st.floats(0, 1), min_size=1, max_size=40), st.integers(1, 8))
def test_no_gain_needs_that_many_steps_without_a_new_best(values, n_steps):
    fired = fires(NoContactGain(n_steps=n_steps, gain=0.01), contacts(*values))
    assert not any(fired[:n_steps])
    for k in np.flatnonzero(fired):
        assert max(values[k - n_steps + 1 : k + 1]) < max(values[: k - n_steps + 1]) + 0.01


def test_steady_gain_or_a_cloth_in_the_air_never_stops_standstill_does_and_a_reset_forgets():
    assert not any(fires(NoContactGain(n_steps=3), contacts(*(0.02 * k for k in range(50)))))
    assert fires(NoContactGain(n_steps=3), contacts(*5 * [0.5])) == [F, F, F, T, T]
    rule = NoContactGain(n_steps=3, from_contact=0.5)
    assert not any(fires(rule, contacts(*30 * [0.0])))
    assert any(fires(rule, contacts(*6 * [0.6])))
    rule.reset()
    assert not any(fires(rule, contacts(0.55, 0.57, 0.6, 0.63, 0.65)))


def test_contact_reached_at_once_or_for_some_steps():
    assert fires(contact_reached(0.9), contacts(0.89, 0.9, 1.0)) == [F, T, T]
    rule, values = contact_reached(0.9, n_steps=2), (0.95, 0.8, 0.95, 0.95, 0.95, 0.8, 0.95)
    assert fires(rule, contacts(*values)) == [F, F, F, T, T, F, F]
    rule.reset()
    assert fires(rule, contacts(*values[2:4])) == [F, T]


def test_x_limit_includes_the_limit():
    assert fires(x_limit(0.5), [observe(x) for x in (0.49, 0.5, 0.6)]) == [F, T, T]


def test_stuck_counts_where_the_holder_is_not_what_was_asked_for():
    rule = Stuck(n_steps=3, within_m=0.02)
    places = (0.1, 0.2, 0.21, 0.215, 0.2, 0.3, 0.3, 0.319)
    assert fires(rule, [observe(x) for x in places], np.full(8, 0.01)) == [F, F, F, T, T, F, F, T]
    rule.reset()
    assert fires(rule, [observe(0.3)] * 3) == [F, F, T]


def test_any_of_updates_every_rule_also_behind_the_first_that_stops():
    rule = AnyOf(contact_reached(0.9), below_threshold(9.0, n_steps=3))
    stops = [rule.update(seen, np.ones(2)) for seen in contacts(0.95, 0.95, 0.0)]
    assert [stop.by if stop else None for stop in stops] == ["converged", "converged", "threshold"]
    rule.reset()
    assert fires(rule, contacts(0.0, 0.0, 0.0)) == [F, F, T]
    assert AnyOf().update(observe(contact=1.0), np.zeros(2)) is None


def test_every_rule_gives_a_word_for_files_and_a_reason():
    contact = [NoContactGain(n_steps=1), contact_reached(0.1)]
    for rule in (below_threshold(1.0), Stuck(n_steps=1, within_m=1.0), x_limit(0.1), *contact):
        stop = [rule.update(observe(0.5, contact=0.5), np.zeros(2)) for _ in range(2)][-1]
        assert stop.by in STOP_REASONS
        assert stop.reason
