"""The curves of a plot, and the marks of outcomes and disturbances on it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from layflat.app.media.episode_plots import INTERVENTION_COLOR, OUTCOME_COLORS, align_curves, curves_of, plot_session
from layflat.data.types import DisturbanceRecord, DragTarget
from layflat.sim.robots.registry import THESIS_ROBOTS


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_curves_are_the_episodes(robot, make_episode):
    episode = make_episode(robot=robot)
    curves = curves_of("demo_0", episode)
    seen = episode.observations()
    np.testing.assert_array_equal(curves.contact, [o.contact_portion for o in seen])
    np.testing.assert_array_equal(curves.holder_m, [o.holder_position for o in seen])
    np.testing.assert_array_equal(curves.actions_m, [step.action for step in episode.steps])
    assert curves.time_s[0] == 0.0
    assert curves.disturbances_s[0] == pytest.approx(seen[episode.phase_bounds("disturb")[0]].time_s)
    assert np.diff(curves.time_s) == pytest.approx(episode.step_s)
    there = np.array([bool(o.word.any()) for o in seen])
    assert np.isnan(curves.word_deg[~there]).all()
    assert (~there).any()
    assert curves.word_deg[there] == pytest.approx(0.0)


def test_time_begins_with_the_disturbance_only_where_all_have_one(make_episode):
    disturbed, calm = (curves_of("demo_0", make_episode(disturbed=d)) for d in (True, False))
    mixed, aligned = align_curves([disturbed, calm])
    assert not aligned
    assert [c.time_s[0] for c in mixed] == [0.0, 0.0]
    (curves,), aligned = align_curves([disturbed])
    assert aligned
    assert curves.time_s[0] == -disturbed.disturbances_s[0]
    assert curves.time_s[60] == pytest.approx(0.0)
    assert curves.disturbances_s[0] == 0.0


def _disturbed(episode):
    """Add wind in steps 5 to 8, a push at 60, a hand on node 1 in 20 and 21 and on node 2 in 22, and a person at 30."""
    records = [DisturbanceRecord(name="wind", first_step=5, last_step=8), DisturbanceRecord(name="push", first_step=60)]
    steps = list(episode.steps)
    for step_index, node in ((20, 1), (21, 1), (22, 2)):
        steps[step_index] = replace(
            steps[step_index], drag=DragTarget(node=node, target_m=[0, 0, 0]), force_n=[0.0, 0.3, 0.4]
        )
    for step_index in range(30, 33):
        steps[step_index] = replace(steps[step_index], intervention=True)
    return replace(episode, steps=steps, disturbances=records)


def test_each_disturbance_pull_and_intervention_has_its_mark(make_episode, tmp_path):
    curves = curves_of("demo_0", _disturbed(make_episode()))
    assert curves.disturbances_s == pytest.approx((0.5, 6.0))
    assert curves.pulls_s == pytest.approx((2.0, 2.2))
    assert curves.interventions_s == (pytest.approx((3.0, 3.3)),)
    (later,), _ = align_curves([curves])
    assert (later.disturbances_s[1], later.pulls_s[0]) == pytest.approx((5.5, 1.5))
    plot_session(tmp_path / "with.png", "title", [curves])
    plot_session(tmp_path / "without.png", "title", [curves_of("demo_0", make_episode(disturbed=False))])
    # Drawn at 0.45 over white.
    tint = "#" + "".join(f"{round(255 - 0.45 * (255 - int(INTERVENTION_COLOR[i : i + 2], 16))):02x}" for i in (1, 3, 5))
    there, missing = (_share(cv2.imread(str(tmp_path / name)), tint) for name in ("with.png", "without.png"))
    assert there > missing + 0.002


@pytest.mark.parametrize("degrees", [-80.0, 0.0, 35.0, 90.0])
def test_the_direction_of_word_is_its_angle_from_x(degrees, make_episode):
    word = [np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]
    episode = make_episode()
    episode = replace(episode, final_observation=replace(episode.final_observation, word=word))
    assert curves_of("demo_0", episode).word_deg[-1] == pytest.approx(degrees)


def _share(picture: np.ndarray, colour: str) -> float:
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return float((np.abs(picture[..., ::-1].astype(int) - rgb).max(axis=2) < 25).mean())


def test_each_outcome_has_its_colour(tmp_path, make_episode):
    outcomes = ["success", "success", "partial"]
    curves = [curves_of(f"demo_{k}", make_episode(seed=k, outcome=o)) for k, o in enumerate(outcomes)]
    assert plot_session(tmp_path / "p.png", "title", curves) == 3
    picture = cv2.imread(str(tmp_path / "p.png"))
    shares = {outcome: _share(picture, colour) for outcome, colour in OUTCOME_COLORS.items()}
    assert min(shares["success"], shares["partial"]) > 3 * shares["failure"]
    assert [p.name for p in tmp_path.iterdir()] == ["p.png"]


def test_an_episode_of_one_step_and_one_of_many_fit_on_one_page(tmp_path, make_episode, lying):
    episodes = [lying(make_episode(robot="pickers"), n_steps=1), make_episode(robot="pickers")]
    curves = [curves_of(f"demo_{k}", episode) for k, episode in enumerate(episodes)]
    assert plot_session(tmp_path / "p.png", "title", curves) == 2
    assert plot_session(tmp_path / "one.png", "title", curves[:1]) == 1
