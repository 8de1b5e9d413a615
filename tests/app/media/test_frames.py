"""Strips of frames, contact sheets and captions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.app.media import frames
from layflat.app.support.phases import phase_spans
from layflat.data.types import DisturbanceRecord, DragTarget


def draw_plain(observation):
    return observation.rgb


def test_strips_show_start_stop_disturbance_and_end(make_episode):
    episode = make_episode(images=True)
    placing = frames.frame_strip(episode, frames.placing_steps(episode), draw_plain, 80)
    assert (len(placing), placing[0].label, placing[-1].label) == (10, "start", "stopped")
    disturbance = frames.frame_strip(episode, frames.disturbance_steps(episode), draw_plain, 80)
    assert [frame.label for frame in disturbance] == [
        "start", "placing", "stopped", "disturbance", "disturbed", *["repair"] * 4, "end",
    ]  # fmt: skip
    assert [frame.step for frame in disturbance] == sorted(frame.step for frame in disturbance)
    assert {frame.image.shape[1] for frame in placing} == {80}
    assert frames.disturbance_steps(make_episode(disturbed=False)) == []


def test_strips_take_the_nearest_frame_that_has_an_image(make_episode):
    episode = make_episode(images=True)
    steps = tuple(
        replace(step, observation=replace(step.observation, rgb=None)) if k % 7 else step
        for k, step in enumerate(episode.steps)
    )
    shown = frames.frame_strip(replace(episode, steps=steps), [0, 6, 10], draw_plain, 80)
    assert [frame.step for frame in shown] == [0, 7, 7]
    assert frames.frame_strip(make_episode(), [0, 6], draw_plain, 80) == []


def test_a_contact_sheet_holds_every_frame_of_its_strips(make_episode):
    episode = make_episode(images=True)
    rows = [frames.frame_strip(episode, steps, draw_plain, 80) for steps in ([0, 5, 10], [12, 15, 20])]
    sheet = frames.contact_sheet(rows)
    height, width = rows[0][0].image.shape[:2]
    assert sheet.shape == (2 * (height + 4), 3 * (width + 4), 3)
    for j in range(2):
        for k in range(3):  # the lower half: the upper has the text on it
            top, left = j * (height + 4) + height // 2, k * (width + 4)
            shown = sheet[top : top + height - height // 2, left : left + width]
            np.testing.assert_array_equal(shown, rows[j][k].image[height // 2 :])
    with pytest.raises(ValueError, match="one length"):
        frames.contact_sheet([rows[0], rows[1][:2]])


@pytest.mark.parametrize("disturbed", [False, True])
def test_key_steps_are_in_order_and_begin_and_end_with_the_episode(make_episode, disturbed):
    episode = make_episode(disturbed=disturbed)
    steps = frames.key_steps(episode, 6)
    assert steps == sorted(set(steps))
    assert (len(steps), steps[0], steps[-1]) == (6, 0, len(episode.steps))
    assert {span.end for span in phase_spans(episode)} <= set(steps)
    assert len(frames.key_steps(episode, 3)) == 3


def test_captions_name_what_acts_on_the_cloth(make_episode):
    records = [
        DisturbanceRecord(name="wind", first_step=5, last_step=8), DisturbanceRecord(name="push", first_step=60)
    ]  # fmt: skip
    steps = list(make_episode().steps)
    drag = DragTarget(node=1, target_m=[0, 0, 0])
    steps[20] = replace(steps[20], drag=drag, force_n=[0.0, 0.3, 0.4])
    steps[31] = replace(steps[31], intervention=True)
    episode = replace(make_episode(), steps=steps, disturbances=records)
    acting = {k: frames.active_disturbances(episode, k) for k in (4, 5, 9, 20, 31, len(steps))}
    assert acting == {4: "", 5: "wind", 9: "", 20: "a hand 0.50 N", 31: "a person decides", len(steps): ""}
    assert frames.caption(episode, 5) == "placing  wind"
