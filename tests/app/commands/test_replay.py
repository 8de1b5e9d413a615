"""Action replay is bit-identical in fresh processes, and says where it is not; state replay shows what is recorded."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from layflat.app.commands.replay import compare, differences, rerun, settings_of, state_report
from layflat.app.media.video import count_frames
from layflat.app.support.errors import UsageError
from layflat.data import SessionRecorder
from layflat.data.types import DisturbanceRecord, GroundTruth
from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.disturbances.presets import DISTURBANCES, DisturbanceTrajectory
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import ROBOTS

SCRIPT = """
import json, sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from layflat.policy.rollout import run_episode
from layflat.app.workers.episode_pool import fresh_processes
from layflat.app.commands.replay import action_report, compare, read_episode, rerun
from layflat.policy.runner import Run
from layflat.policy.schedule import ScheduledDisturbance, When
from data import SessionRecorder
from layflat.data.types import Pull
from layflat.policy.base import Decision
from layflat.policy.scripted.baselines import RandomPolicy as RandomMoves, ZeroPolicy as Hold
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.simulation import Placing
from layflat.sim.config import BenchSettings

class Short(RandomMoves):
    left = 6
    def act(self, observation):
        self.left -= 1
        decision = super().act(observation)
        return decision if self.left >= 0 else Decision(action=decision.action, stop="converged")
    def continue_after_disturbance(self):
        self.left = 3

def by_hand(bench, robot):
    # A person pulls at one node and at another, beside two disturbances, and then leads the holder.
    policy = Hold(robot)
    run = Run(bench, policy, seed=5)
    down = np.tile([0.0, 0.0, -0.01], 2) if robot == "pickers" else np.array([0.002, -0.012])
    policy.act = lambda seen: Decision(action=down)
    for step in range(12):
        if step in (3, 6):
            run.disturb({3: "wind", 6: "push"}[step], repeat=step)
        if step == 9:
            held = run.seen.holder_position if robot == "hanger" else run.seen.corner_positions
            policy.act = lambda seen: Decision(action=down, hand=held + [0.05, 0.0, -0.05])
        where = run.truth.nodes[20] + [0.02, 0.01, 0.01]
        pull = Pull(node=20 if step < 6 else 90, target_m=where) if step in (2, 3, 4, 7, 8, 10) else None
        assert run.step("place", pull) is None
    return run.episode("interrupted", "partial")

SCHEDULES = {"twice": [
    ScheduledDisturbance(disturbance=DISTURBANCES["wind"], when=When(moment="step", value=2)),
    ScheduledDisturbance(disturbance=DISTURBANCES["poke"], repeats=2),
]}

def record(robot, cloth, disturbance):
    bench = Placing(BenchSettings(robot=robot, cloth=cloth, table_friction=0.9))
    bench.reset(5)
    if disturbance == "by hand":
        return by_hand(bench, robot)
    schedule = SCHEDULES.get(disturbance, ())
    return run_episode(bench, Short(robot), seed=5, disturbance=disturbance, schedule=schedule)

if __name__ == "__main__":
    robot, cloth, disturbance, path = sys.argv[1:]
    with fresh_processes(1) as pool, SessionRecorder(path, robot=robot, cloth=cloth) as recorder:
        recorder.save(pool.schedule(record, args=[robot, cloth, disturbance]).result())
    kept = read_episode(Path(path), 0)
    again = rerun(kept)
    told = {"phases": sorted({step.phase for step in kept.steps})}
    told["befell"] = [[record.name, record.first_step, record.last_step] for record in kept.disturbances]
    told["forces"] = [bool(step.force_n.any()) for step in kept.steps]
    told["forces_again"] = all(np.array_equal(a.force_n, b.force_n) for a, b in zip(kept.steps, again.steps))
    told["same"] = action_report(kept, again, compare(kept, again))
    if disturbance == "poke":
        (befell,) = kept.disturbances
        path_m = [[-x for x in corner] for corner in befell.plan["path_m"]]
        changed = replace(kept, disturbances=[replace(befell, plan={**befell.plan, "path_m": path_m})])
        elsewhere = rerun(changed)
        told["changed"] = action_report(changed, elsewhere, compare(changed, elsewhere))
    print(json.dumps(told))
"""


PLAN = DISTURBANCES["push"].sample(np.random.default_rng(0), cloth_spec("towel")).described()


def _replay(path: Path, *arguments: str) -> subprocess.CompletedProcess:
    call = [sys.executable, "-m", "layflat.app.cli.main", "replay", str(path), "--episode", "0", *arguments]
    return subprocess.run(call, capture_output=True, text=True, check=False)


def _again(path: Path) -> dict:
    out = path.with_suffix(".json")
    done = _replay(path, "--mode", "action", "--json", str(out), "--force")
    assert done.returncode == 0, done.stderr
    return json.loads(out.read_text())


def _told(robot: str, cloth: str, disturbance: str, tmp_path: Path) -> dict:
    """What SCRIPT tells of an episode and of its replay, each made in a fresh process."""
    call = [sys.executable, "-c", SCRIPT, robot, cloth, disturbance, str(tmp_path / "s.h5")]
    done = subprocess.run(call, check=True, stdout=subprocess.PIPE, text=True)
    told: dict = json.loads(done.stdout.splitlines()[-1])
    return told


@pytest.mark.parametrize("robot", ROBOTS)
def test_what_hands_did_runs_again_to_the_bit(robot, tmp_path):
    told = _told(robot, "napkin", "by hand", tmp_path)
    assert told["same"]["identical"] is True
    assert told["forces_again"] is True
    # A push that comes while a wind still settles takes its place.
    assert told["befell"] == [["wind", 3, 5], ["push", 6, None]]
    assert told["forces"][:3] == [False, False, True]


def test_repeated_disturbances_run_again_to_the_bit(tmp_path):
    told = _told("pickers", "napkin", "twice", tmp_path)
    assert told["same"]["identical"] is True
    assert told["forces_again"] is True
    assert [name for name, *_ in told["befell"]] == ["wind", "poke", "poke"]
    assert told["befell"][0][1] == 2


@pytest.mark.parametrize(
    ("robot", "cloth", "disturbance"), [("hanger", "towel", "wind"), ("pickers", "napkin", "poke")], ids=ROBOTS
)
def test_a_disturbed_episode_runs_again_to_the_bit(robot, cloth, disturbance, tmp_path):
    told = _told(robot, cloth, disturbance, tmp_path)
    assert told["phases"] == ["disturb", "place", "repair"]
    same = told["same"]
    assert same["identical"] is True
    assert same["max_node_error_m"] == same["max_corner_error_m"] == same["max_contact_error"] == 0.0
    assert same["first_divergent_step"] is None
    assert same["steps"] == same["steps_again"] > 15
    assert len(same["per_step"]["node_error_m"]) == same["steps"] + 1
    assert not same["changed_versions"]
    if robot == "pickers":
        # A hand that goes the other way, from step 6 on, leads elsewhere, and that is told.
        assert told["changed"]["identical"] is False
        assert told["changed"]["first_divergent_step"] == 7
        assert told["changed"]["max_node_error_m"] > 0.001


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_whole_demonstration_runs_again_to_the_bit(robot, tmp_path):
    path = tmp_path / "s.h5"
    call = [
        sys.executable,
        "-m",
        "layflat.app.cli.main",
        "record",
        str(path),
        "--robot",
        robot,
        "--episodes",
        "1",
        "--seed",
        "7",
    ]
    subprocess.run(call, check=True)
    report = _again(path)
    assert report["identical"] is True
    assert report["steps"] > 50


def test_an_episode_does_not_differ_from_itself(make_episode):
    episode = make_episode()
    divergence = compare(episode, episode)
    assert divergence.identical
    assert divergence.first_step is None
    assert len(divergence.node_error_m) == len(episode.steps) + 1
    assert not divergence.node_error_m.any()


def test_the_divergence_is_the_largest_distance_of_its_step(make_episode):
    episode = make_episode(disturbed=False)
    shift = np.zeros((4, 3))
    shift[2] = [0.003, 0.0, -0.004]
    steps = list(episode.steps)
    far = GroundTruth(nodes=steps[7].ground_truth.nodes + shift, contact_portion_true=0.5, flat_area=0.5)
    steps[7] = replace(steps[7], ground_truth=far)
    seen = steps[9].observation
    corners = seen.corner_positions + np.array([[0, 0, 0], [0, 0.002, 0]])
    steps[9] = replace(
        steps[9], observation=replace(seen, corner_positions=corners, contact_portion=seen.contact_portion - 0.25)
    )
    divergence = compare(episode, replace(episode, steps=tuple(steps)))
    assert not divergence.identical
    assert divergence.first_step == 7
    assert divergence.node_error_m[7] == pytest.approx(0.005)
    assert np.flatnonzero(divergence.node_error_m).tolist() == [7]
    assert divergence.corner_error_m[9] == pytest.approx(0.002)
    assert divergence.contact_error[9] == pytest.approx(-0.25)
    assert differences(divergence) == ["nodes by up to 5 mm", "corners by up to 2 mm", "contact by up to 0.25"]


def test_one_bit_is_a_difference(make_episode):
    episode = make_episode()
    seen = episode.final_observation
    other = replace(seen, contact_portion=float(np.nextafter(seen.contact_portion, 2)))
    divergence = compare(episode, replace(episode, final_observation=other))
    assert not divergence.identical
    assert divergence.first_step == len(episode.steps)
    assert differences(divergence)[:2] == ["nodes identical", "corners identical"]


def test_a_shorter_run_is_not_identical_even_where_it_agrees(make_episode):
    episode = make_episode()
    last = episode.steps[-1]
    short = replace(
        episode, steps=episode.steps[:-1], final_observation=last.observation, final_ground_truth=last.ground_truth
    )
    divergence = compare(episode, short)
    assert not divergence.identical
    assert divergence.first_step is None
    assert len(divergence.node_error_m) == len(episode.steps)


def _planned(plan: dict) -> dict:
    return {"disturbances": [DisturbanceRecord(name="push", first_step=3, plan=plan)]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cloth": "silk"}, "'silk'.*napkin"),
        ({"disturbances": [DisturbanceRecord(name="earthquake", first_step=3)]}, "'earthquake'.*push"),
        ({"first_step": 3}, "first 3 steps"),
        ({"bench": {"gravity": 3.7}}, "gravity"),
        ({"bench": {"noise": "much"}}, "noise 'much'"),
        ({"step_s": 7.0}, r"step_s is 7\.0"),
        (_planned({"nodes": [1]}), "cannot be read"),
        (_planned(PLAN | {"nodes": [10**6]}), "does not fit this cloth"),
        (_planned(PLAN | {"path_m": [[0.0, float("inf"), 0.0]]}), "does not fit this cloth"),
    ],
    ids=str,
)
def test_what_cannot_run_again_is_one_sentence(change, message, make_episode):
    with pytest.raises(UsageError, match=message):
        rerun(make_episode(**change))


def test_an_imported_episode_without_a_seed_cannot_run_again(make_episode):
    with pytest.raises(UsageError, match=r"seed is -1.*--mode state"):
        rerun(replace(make_episode(), seed=-1))


def test_the_bench_is_as_the_file_says(make_episode):
    told = settings_of(make_episode(bench={"table_friction": 0.7, "noise": False, "control": "position"}))
    assert (told.table_friction, told.noise, told.control, told.cloth) == (0.7, False, "position", "towel")
    assert settings_of(make_episode(start={"table_friction": 0.6})).table_friction == 0.6
    assert settings_of(make_episode()).table_friction == 1.0


def test_state_replay_tells_each_moment(make_episode):
    episode = make_episode(disturbances=[DisturbanceRecord(name="push", first_step=60, last_step=69, plan=PLAN)])
    report = state_report(episode)
    assert report["disturbances"] == [{"name": "push", "first_step": 60, "last_step": 69, "plan": PLAN}]
    assert report["forces_n"] == [[0.0, 0.0, 0.0]] * len(episode.steps)
    columns = report["per_step"]
    assert len(columns["phase"]) == len(episode.steps)
    assert all(len(column) == len(episode.steps) + 1 for key, column in columns.items() if key != "phase")
    assert columns["contact_portion"] == [o.contact_portion for o in episode.observations()]
    assert columns["flat_area"][-1] == episode.final_ground_truth.flat_area
    json.dumps(report, allow_nan=False)


def test_state_replay_prints_films_and_writes(tmp_path, make_episode, lying):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot="pickers", cloth="towel") as recorder:
        recorder.save(lying(make_episode(robot="pickers"), n_steps=6))
    done = _replay(path, "--json", str(tmp_path / "s.json"), "--video", str(tmp_path / "s.webm"))
    assert done.returncode == 0, done.stderr
    assert "place" in done.stdout
    assert json.loads((tmp_path / "s.json").read_text())["mode"] == "state"
    assert count_frames(tmp_path / "s.webm") == 7


@pytest.mark.parametrize("name", DISTURBANCES)
def test_a_plan_survives_its_description(name):
    cloth = cloth_spec("towel")
    plan = DISTURBANCES[name].sample(np.random.default_rng(4), cloth)
    again = DisturbanceTrajectory.recorded(json.loads(json.dumps(plan.described())), cloth)
    assert again.described() == plan.described()
    assert all(type(getattr(again, key)) is type(value) for key, value in vars(plan).items())
    for time_s in (0.0, 0.3, 2.0):
        for a, b in zip(again.target(time_s), plan.target(time_s), strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_plan_from_before_hands_could_turn_is_one_that_does_not():
    cloth = cloth_spec("towel")
    described = {key: value for key, value in PLAN.items() if key != "turn_rad"}
    assert DisturbanceTrajectory.recorded(described, cloth).described() == PLAN
    for broken in ([1.0, 2.0], "over", [math.nan, 0.0, 0.0]):
        with pytest.raises(SimError, match="cannot be read"):
            DisturbanceTrajectory.recorded(PLAN | {"turn_rad": broken}, cloth)
