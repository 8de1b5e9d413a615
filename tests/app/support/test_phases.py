"""Phases and disturbances of an episode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.app.support.phases import disturbance_outcomes, disturbed_spans, phase_spans
from layflat.data.types import DisturbanceRecord


def _numbered(episode):
    """Give the episode a contact portion of 0.001 in step 1, 0.002 in step 2, ..."""
    seen = [replace(o, contact_portion=0.001 * k) for k, o in enumerate(episode.observations())]
    steps = tuple(replace(step, observation=o) for step, o in zip(episode.steps, seen[:-1], strict=True))
    return replace(episode, steps=steps, final_observation=seen[-1])


def test_spans_cover_the_episode_in_order(make_episode):
    episode = make_episode()
    spans = phase_spans(episode)
    assert [span.phase for span in spans] == ["place", "disturb", "repair"]
    assert [span.first for span in spans] == [0, *(span.end for span in spans[:-1])]
    assert spans[-1].end == len(episode.steps)
    for span in spans:
        assert episode.phase_bounds(span.phase) == (span.first, span.end)
    assert phase_spans(replace(episode, steps=())) == ()


def test_each_recorded_disturbance_has_its_contacts(make_episode):
    """One while placing, one after it, and one more that is never over."""
    spans = [("wind", 10, 19), ("push", 60, 69), ("push", 80, None)]
    records = [DisturbanceRecord(name=name, first_step=first, last_step=last) for name, first, last in spans]
    outcomes = disturbance_outcomes(_numbered(make_episode(disturbances=records)))
    assert [outcome.name for outcome in outcomes] == ["wind", "push", "push"]
    contacts = [contact for o in outcomes for contact in (o.before, o.disturbed, o.final)]
    assert contacts == pytest.approx([0.010, 0.020, 0.060, 0.060, 0.070, 0.080, 0.080, 0.095, 0.095])
    assert outcomes[0].regained == pytest.approx(0.040)


def test_without_records_the_phases_tell_the_disturbances_apart(make_episode):
    once = make_episode(gain=0.08)
    begin, end = once.phase_bounds("disturb")[0], once.phase_bounds("repair")[1]
    again = replace(once.steps[begin], observation=once.final_observation)
    twice = replace(once, steps=(*once.steps, again, *once.steps[begin + 1 : end]))
    assert [span.phase for span in phase_spans(twice)] == ["place", "disturb", "repair", "disturb", "repair"]
    assert len(disturbed_spans(twice)) == 2
    first, second = disturbance_outcomes(twice)
    assert (first.regained, second.regained) == pytest.approx((0.08, 0.08))
    assert (first.before, second.before) == (pytest.approx(0.96, abs=0.02), pytest.approx(0.82 + 0.08))
    assert {first.name, second.name} == {"push"}
    assert disturbance_outcomes(make_episode(disturbed=False)) == ()


def test_sensor_noise_above_one_is_cut_off(make_episode):
    episode = make_episode()
    noisy = replace(episode, final_observation=replace(episode.final_observation, contact_portion=1.03))
    assert disturbance_outcomes(noisy)[0].final == np.float64(1.0)
