"""The digital twin: the robot's own protocol on loopback and the camera's own library, end to end."""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from layflat.app.commands.place import PlaceConfig, place
from layflat.app.commands.record import record
from layflat.app.commands.station import CheckConfig, TwinConfig, check
from layflat.app.commands.station import twin as twin_command
from layflat.app.hardware.franka_arm import FrankaArm
from layflat.app.hardware.station_config import RobotConfig, StationError
from layflat.app.hardware.station_environment import StationEnvironment
from layflat.app.hardware.station_episode import run_station_episode
from layflat.app.hardware.twin.arm_process import ArmProcess
from layflat.app.hardware.twin.twin import Twin
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workers.work_item import NO_DISTURBANCE
from layflat.data.session.reader import open_session
from layflat.policy.base import Decision
from layflat.policy.environment import Environment
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.robots.panda import inverse_kinematics
from layflat.sim.starts.base import home_corners

MISSING = [name for name in ("franky", "franky_sim", "pyrealsense2") if find_spec(name) is None]
pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(bool(MISSING), reason=f"needs layflat[station]: {', '.join(MISSING)}"),
]


class Steps:
    """A policy of given actions, which then stops."""

    name = label = "steps"

    def __init__(self, *actions: tuple[float, float]) -> None:
        self._actions = list(actions)

    def make(self, env: Environment) -> Steps:
        self.robot = env.spec.robot
        return self

    def reset(self, seed: int) -> None:
        self._left = list(self._actions)

    def act(self, observation: object) -> Decision:
        if not self._left:
            return Decision(action=np.zeros(2), stop="converged")
        return Decision(action=np.array(self._left.pop(0)))


def hold(env: StationEnvironment, steps: int) -> None:
    """Stay where the arm is, and look."""
    for _ in range(steps):
        env.step(np.zeros(2))
        env.observe()


@pytest.fixture(scope="module")
def twin() -> Iterator[Twin]:
    with Twin() as running:
        yield running


def test_the_arm_goes_where_a_policy_says_and_the_camera_sees_the_cloth(twin: Twin) -> None:
    env = twin.env
    env.reset(3)
    before = env.observe()
    assert before.contact_portion == 0.0
    assert before.free_edge_m is not None
    for _ in range(8):
        env.step(np.array([0.005, -0.005]))
    after = env.observe()
    assert after.holder_position - before.holder_position == pytest.approx([0.04, 0.0, -0.04], abs=0.02)
    assert env.joint_angles().shape == (7,)
    truth = env.ground_truth()
    assert truth is not None
    # The corners of the cloth are where the robot says that its clips are.
    assert truth.nodes[list(env.config.cloth_spec().corners)] == pytest.approx(env.corner_positions(), abs=0.006)
    assert after.time_s - before.time_s >= 0.75


def test_a_jump_stops_the_arm_and_keeps_the_episode_as_partial(twin: Twin) -> None:
    episode, reason = run_station_episode(twin.env, Steps((0.0, -0.01), (0.0, -0.01), (0.0, -0.3)), 4, NO_DISTURBANCE)
    assert (episode.outcome, len(episode.steps)) == ("partial", 2)
    assert reason is not None
    assert "the command jumps" in reason
    place = twin.arm.position()
    time.sleep(0.3)
    assert twin.arm.position() == pytest.approx(place, abs=0.02)


def test_a_hand_guides_the_arm_and_its_actions_are_what_it_did(twin: Twin, monkeypatch: pytest.MonkeyPatch) -> None:
    env, base = twin.env, np.array(twin.config.robot.base_m)
    env.reset(5)
    start, actions, reads = env.arm.position(), [], []
    position = env.arm.position

    def watched() -> np.ndarray:
        reads.append(position())
        return reads[-1]

    monkeypatch.setattr(env.arm, "position", watched)
    for k in range(15):
        # The hand's frame is above the clips.
        target = start - base + np.array([0.01 * k, 0.0, twin.config.robot.tool_m + 0.1034 - 0.006 * k])
        twin.arm_process.push(target.tolist())
        actions.append(env.guide(None))
    twin.arm_process.push(None)
    moved = reads[-1] - reads[0]
    assert np.sum(actions, axis=0) == pytest.approx(moved[[0, 2]], abs=1e-9)
    assert moved[0] > 0.05
    env.step(np.zeros(2))
    assert env.arm.position() == pytest.approx(start + moved, abs=0.03)


def test_a_way_home_that_is_blocked_is_given_up_with_a_bounded_force(twin: Twin) -> None:
    env, base = twin.env, np.array(twin.config.robot.base_m)
    env.reset(5)
    for _ in range(10):
        env.step(np.array([0.012, -0.012]))
    # A person holds the hand where it is.
    held = env.arm.position() - base + np.array([0.0, 0.0, twin.config.robot.tool_m + 0.1034])
    twin.arm_process.push(held.tolist())
    try:
        with pytest.raises(StationError, match="the arm is blocked"):
            env.reset(5)
        lead = np.abs(env.arm.set_point() - env.arm.position()).max()
        assert lead * twin.config.robot.stiffness_n_m <= twin.config.robot.force_n * 1.2
    finally:
        twin.arm_process.push(None)
    env.reset(5)
    assert env.arm.position() == pytest.approx(env.home(), abs=0.05)


def test_a_hand_that_is_turned_is_left_to_a_person() -> None:
    home = home_corners(cloth_spec("towel")).mean(axis=0)
    turned = inverse_kinematics(home) + np.array([0, 0, 0, 0, 0, 0, 0.3])
    process = ArmProcess(turned.tolist())
    arm = FrankaArm(RobotConfig(host=process.host))
    try:
        with pytest.raises(StationError, match="turned by 17 degrees"):
            arm.start_control()
    finally:
        arm.stop()
        process.close()


@pytest.mark.parametrize("fault", ["unplugged", "frozen"])
def test_a_camera_fault_is_one_sentence_and_passes(twin: Twin, fault: str) -> None:
    env, camera = twin.env, twin.cloth.camera
    env.reset(6)
    feed, last = camera.feed, camera.feed
    frozen = twin.camera.frame()
    camera.feed = (lambda rgb, depth: last(rgb, frozen.depth)) if fault == "frozen" else (lambda rgb, depth: None)  # type: ignore[method-assign, assignment]
    try:
        with pytest.raises(StationError, match="no new frame for 2 s"):
            hold(env, 3)
    finally:
        camera.feed = feed  # type: ignore[method-assign]
    env.step(np.zeros(2))
    assert env.observe().rgb is not None


def test_a_cut_connection_is_one_sentence() -> None:
    with Twin() as twin:
        twin.env.reset(0)
        threading.Timer(1.0, twin.arm_process.kill).start()
        with pytest.raises(StationError) as caught:
            hold(twin.env, 100)
        assert "\n" not in str(caught.value)
        assert "robot" in str(caught.value) or "arm" in str(caught.value)


def test_the_readings_of_a_station_are_a_page(tmp_path: Path) -> None:
    page = tmp_path / "check.html"
    status = check(CheckConfig(station=Path("twin"), out=page, steps=30), force=False)
    text = page.read_text()
    assert ("The station is ready" in text) == (status == 0)
    rows = {
        name: float(value)
        for name, value in re.findall(r"<td[^>]*>([^<]+)</td><td[^>]*>(?:<span[^>]*>)?([\d.]+) ", text)
    }
    # What the twin is made with: D435 noise of 3 mm, a camera of 30 frames a second, an arm at rest.
    assert rows["depth noise, median of pixels"] == pytest.approx(3.0, abs=0.5)
    assert rows["camera rate"] == pytest.approx(30, abs=6)
    assert rows["arm&#39;s error at rest, largest"] < 2.0


def test_episodes_are_recorded_and_placed_at_the_twin(tmp_path: Path) -> None:
    """``place --station`` and ``record --station``: rows, durable episodes, and every command beside them."""
    config = RecordConfig(path=tmp_path / "s.h5", station=Path("twin"), episodes=1, seed=2)
    record(config, force=False, workers=1)
    with open_session(config.path) as session:
        (episode,) = session.episodes()
    assert (episode.source, episode.physics, episode.outcome) == ("scripted", "twin", "success")
    commands = json.loads((tmp_path / "s.demo_0.commands.json").read_text())["commands"]
    assert len(commands) == len(episode.steps)
    assert set(commands[0]) == {"time_s", "wanted_m", "sent_m", "measured_m"}
    rows = tmp_path / "rows.json"
    place(PlaceConfig(policy="hold", seed=20000, json=rows, station=Path("twin")), workers=1, force=False)
    (row,) = json.loads(rows.read_text())["episodes"]
    assert (row["policy"], row["physics"], row["seed"]) == ("hold", "twin", 20000)


@pytest.mark.slow
def test_teaching_placing_and_repairing_on_the_twin(tmp_path: Path) -> None:
    out = tmp_path / "twin"
    twin_command(TwinConfig(out=out, episodes=1, seed=12000), force=False)
    summary = json.loads((out / "summary.json").read_text())
    assert len(summary["groups"]) == 2
    for group in summary["groups"]:
        assert group["physics"] == "twin"
        assert group["contact_final"]["mean"] > 0.97
    assert len(list((out / "runs").glob("*.commands.json"))) == 2
    with open_session(out / "demonstrations.h5") as session:
        assert len(session) == 5
