"""Action replay is bit-identical in fresh processes, and reports where it is not; state replay shows the recording."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from layflat.app.commands.replay import compare, differences, recorded_config, rerun, state_report
from layflat.app.media.video import count_frames
from layflat.app.support.errors import UsageError
from layflat.data import SessionRecorder
from layflat.data.types import DisturbanceRecord, GroundTruth
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import THESIS_ROBOTS, robot_spec

SCRIPT = """
import json, sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from layflat.app.commands.replay import action_report, compare, rerun
from layflat.app.workers.process import process_pool
from layflat.data import SessionRecorder, open_session
from layflat.data.types import DragTarget
from layflat.policy.base import Decision
from layflat.policy.rollout import rollout
from layflat.policy.runner import EpisodeRunner
from layflat.policy.schedule import ScheduledDisturbance, Trigger
from layflat.policy.scripted.baselines import RandomPolicy, ZeroPolicy
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import robot_spec
from layflat.sim.simulation import ClothSimulation

class ShortPolicy(RandomPolicy):
    left = 6
    def act(self, observation):
        self.left -= 1
        decision = super().act(observation)
        return decision if self.left >= 0 else Decision(action=decision.action, stop="converged")
    def continue_after_disturbance(self):
        self.left = 3

def by_hand(env, robot):
    # A person drags one node and another, beside two disturbances, and then guides the robot.
    policy = ZeroPolicy(robot)
    env.reset(5)
    run = EpisodeRunner(env, policy, seed=5)
    down = robot.pack([0.002, 0.0, -0.012] if robot.n_points == 1 else [0.0, 0.0, -0.01])
    policy.act = lambda seen: Decision(action=down)
    for step in range(12):
        if step in (3, 6):
            run.disturb({3: "wind", 6: "push"}[step], repeat=step)
        if step == 9:
            held = run.observation.holder_position if robot.n_points == 1 else run.observation.corner_positions
            policy.act = lambda seen: Decision(action=down, hand=held + [0.05, 0.0, -0.05])
        where = run.ground_truth.nodes[20] + [0.02, 0.01, 0.01]
        drag = DragTarget(node=20 if step < 6 else 90, target_m=where) if step in (2, 3, 4, 7, 8, 10) else None
        assert run.step("place", drag) is None
    return run.build_episode("interrupted", "partial")

SCHEDULES = {"twice": [
    ScheduledDisturbance(disturbance="wind", trigger=Trigger(kind="step", value=2)),
    ScheduledDisturbance(disturbance="poke", repeats=2),
]}

def record(robot, cloth, disturbance):
    env = ClothSimulation(SimConfig(robot=robot, cloth=cloth, table_friction=0.9))
    if disturbance == "by hand":
        return by_hand(env, robot_spec(robot))
    schedule = SCHEDULES.get(disturbance, ())
    return rollout(env, ShortPolicy(robot_spec(robot)), seed=5, disturbance=disturbance, schedule=schedule)

if __name__ == "__main__":
    robot, cloth, disturbance, path = sys.argv[1:]
    with process_pool(1) as pool, SessionRecorder(path, robot=robot_spec(robot), cloth=cloth) as recorder:
        recorder.save(pool.schedule(record, args=[robot, cloth, disturbance]).result())
    with open_session(path) as session:
        saved = session.episode("demo_0", images=False)
    again = rerun(saved)
    report = {"phases": sorted({step.phase for step in saved.steps})}
    report["disturbances"] = [[record.name, record.first_step, record.last_step] for record in saved.disturbances]
    report["forces"] = [bool(step.force_n.any()) for step in saved.steps]
    report["forces_again"] = all(np.array_equal(a.force_n, b.force_n) for a, b in zip(saved.steps, again.steps))
    report["same"] = action_report(saved, again, compare(saved, again))
    if disturbance == "poke":
        (poke,) = saved.disturbances
        path_m = [[-x for x in corner] for corner in poke.plan["path_m"]]
        changed = replace(saved, disturbances=[replace(poke, plan={**poke.plan, "path_m": path_m})])
        elsewhere = rerun(changed)
        report["changed"] = action_report(changed, elsewhere, compare(changed, elsewhere))
    print(json.dumps(report))
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


def _run_script(robot: str, cloth: str, disturbance: str, tmp_path: Path) -> dict:
    """Return the report of SCRIPT on an episode and its replay, each made in a fresh process."""
    call = [sys.executable, "-c", SCRIPT, robot, cloth, disturbance, str(tmp_path / "s.h5")]
    done = subprocess.run(call, check=True, stdout=subprocess.PIPE, text=True)
    report: dict = json.loads(done.stdout.splitlines()[-1])
    return report


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_an_episode_by_hand_runs_again_to_the_bit(robot, tmp_path):
    report = _run_script(robot, "napkin", "by hand", tmp_path)
    assert report["same"]["identical"] is True
    assert report["forces_again"] is True
    # A push that comes while a wind still settles takes its place.
    assert report["disturbances"] == [["wind", 3, 5], ["push", 6, None]]
    assert report["forces"][:3] == [False, False, True]


def test_repeated_disturbances_run_again_to_the_bit(tmp_path):
    report = _run_script("pickers", "napkin", "twice", tmp_path)
    assert report["same"]["identical"] is True
    assert report["forces_again"] is True
    assert [name for name, *_ in report["disturbances"]] == ["wind", "poke", "poke"]
    assert report["disturbances"][0][1] == 2


@pytest.mark.parametrize(
    ("robot", "cloth", "disturbance"), [("hanger", "towel", "wind"), ("pickers", "napkin", "poke")], ids=THESIS_ROBOTS
)
def test_a_disturbed_episode_runs_again_to_the_bit(robot, cloth, disturbance, tmp_path):
    report = _run_script(robot, cloth, disturbance, tmp_path)
    assert report["phases"] == ["disturb", "place", "repair"]
    same = report["same"]
    assert same["identical"] is True
    assert same["max_node_error_m"] == same["max_corner_error_m"] == same["max_contact_error"] == 0.0
    assert same["first_divergent_step"] is None
    assert same["steps"] == same["steps_again"] > 15
    assert len(same["per_step"]["node_error_m"]) == same["steps"] + 1
    assert not same["changed_versions"]
    if robot == "pickers":
        # A hand that goes the other way, from step 6 on, leads elsewhere, and the report says so.
        assert report["changed"]["identical"] is False
        assert report["changed"]["first_divergent_step"] == 7
        assert report["changed"]["max_node_error_m"] > 0.001


@pytest.mark.slow
@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_a_whole_demonstration_runs_again_to_the_bit(robot, tmp_path):
    path = tmp_path / "s.h5"
    words = ["record", str(path), "--robot", robot, "--episodes", "1", "--seed", "7"]
    subprocess.run([sys.executable, "-m", "layflat.app.cli.main", *words], check=True)
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
        ({"sim_config": {"gravity": 3.7}}, "gravity"),
        ({"sim_config": {"noise": "much"}}, "noise 'much'"),
        ({"step_s": 7.0}, r"step_s is 7\.0"),
        ({"physics": "real"}, "physics 'real' is unknown"),
        (_planned({"nodes": [1]}), "cannot be read"),
        (_planned(PLAN | {"nodes": [10**6]}), "does not fit this cloth"),
        (_planned(PLAN | {"path_m": [[0.0, float("inf"), 0.0]]}), "does not fit this cloth"),
    ],
    ids=str,
)
def test_an_episode_that_cannot_run_again_is_one_sentence(change, message, make_episode):
    with pytest.raises(UsageError, match=message):
        rerun(make_episode(**change))


def test_an_imported_episode_without_a_seed_cannot_run_again(make_episode):
    with pytest.raises(UsageError, match=r"seed is -1.*--mode state"):
        rerun(replace(make_episode(), seed=-1))


def test_the_simulation_is_that_of_the_file(make_episode):
    report = recorded_config(make_episode(sim_config={"table_friction": 0.7, "noise": False, "control": "position"}))
    assert (report.table_friction, report.noise, report.control, report.cloth) == (0.7, False, "position", "towel")
    assert recorded_config(make_episode(start={"table_friction": 0.6})).table_friction == 0.6
    assert recorded_config(make_episode()).table_friction == 1.0
    smooth = recorded_config(make_episode(robot="pickers", task="smooth", sim_config={"start": "crumpled"}))
    assert (smooth.task, smooth.start) == ("smooth", "crumpled")


def test_state_replay_reports_every_step(make_episode):
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
    with SessionRecorder(path, robot=robot_spec("pickers"), cloth="towel") as recorder:
        recorder.save(lying(make_episode(robot="pickers"), n_steps=6))
    done = _replay(path, "--json", str(tmp_path / "s.json"), "--video", str(tmp_path / "s.webm"))
    assert done.returncode == 0, done.stderr
    assert "place" in done.stdout
    assert json.loads((tmp_path / "s.json").read_text())["mode"] == "state"
    assert count_frames(tmp_path / "s.webm") == 7
