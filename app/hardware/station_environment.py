"""StationEnvironment: the real arm and camera as an environment; a twin puts a simulated cloth under them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, fields
from typing import Any, Protocol

import numpy as np

from layflat.app.hardware.franka_arm import FrankaArm
from layflat.app.hardware.realsense_camera import CameraFrame, RealSenseCamera
from layflat.app.hardware.safety_limits import SafetyLimits
from layflat.app.hardware.station_config import StationConfig, StationError
from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.data.environment_spec import ClothShape, EnvironmentSpec
from layflat.data.types import STEP_S, DisturbanceRecord, GroundTruth, Observation
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, make_descriptor
from layflat.policy.environment import Environment
from layflat.sim.robots.hanger import PandaHanger
from layflat.sim.simulation import START_STREAM
from layflat.sim.starts.base import home_corners
from layflat.sim.starts.hanging import START_MOVES
from layflat.sim.tasks import TASKS

PHYSICS = "station"
"""What episodes of a real station have in place of an engine's name."""
SETTLE_S = 1.0
"""Time in which the cloth comes to rest before an episode."""
SLOW_M_S, ARRIVED_M, BLOCKED_STEPS = 0.08, 0.001, 20
"""Speed of the way home; where it ends; steps without progress after which something is in the way."""
FRAME_AGE_S = 0.05
"""Age of the frame that stands for a step's end: to wait for a newer one would make steps uneven."""


class Scene(Protocol):
    """The simulated cloth under the arm of a twin; a real station has none."""

    physics: str

    def begin(self, corners: FloatArray, seed: int) -> None:
        """Hang the cloth at ``corners``, (2, 3) m world."""

    def follow(self, path: list[FloatArray], axes: FloatArray) -> None:
        """Let a control step pass while the held point goes along ``path``, (3,) m each."""

    def ground_truth(self) -> GroundTruth | None:
        """Return what only a simulator knows."""

    def disturb(self, disturbance: Any, repeat: int) -> DisturbanceRecord | None:
        """Start a disturbance."""

    @property
    def disturbed(self) -> bool:
        """Whether a disturbance still acts."""

    def streaming(self) -> AbstractContextManager[None]:
        """Send pictures while no step passes."""

    def close(self) -> None:
        """Free what the scene holds."""


class StationEnvironment(Environment):
    """A station in which a policy acts. Observations have the same keys, units and frames as the simulation's.

    ``ready`` is called before an episode, once the arm is at its start: a person hangs the cloth and confirms.
    ``slow`` stretches every control step by this factor: the same path, for a first run.
    """

    def __init__(
        self,
        config: StationConfig,
        arm: FrankaArm,
        camera: RealSenseCamera,
        *,
        scene: Scene | None = None,
        descriptor: str = DEFAULT_DESCRIPTOR,
        flat_pixels: int | None = None,
        slow: float = 1.0,
        ready: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.config, self.arm, self.camera, self.scene = config, arm, camera, scene
        self.descriptor, self._ready = descriptor, ready
        self._step_s = STEP_S * slow
        self._limits = SafetyLimits(config.robot)
        self._cloth = config.cloth_spec()
        seen = config.camera
        pinhole = camera.intrinsics.camera_at(seen.cam_to_world())
        color = HsvRange(
            hue_min=seen.hue_deg[0],
            hue_max=seen.hue_deg[1],
            saturation_min=seen.saturation_min,
            value_min=seen.value_min,
        )
        self._perception = PerceptionPipeline(
            pinhole,
            PerceptionConfig(descriptor=make_descriptor(descriptor), color=color),
            flat_pixels=flat_pixels or seen.flat_pixels or None,
        )
        shape = {item.name: getattr(self._cloth, item.name) for item in fields(ClothShape)}
        task = TASKS["place"]
        self._spec = EnvironmentSpec(
            robot=PandaHanger.spec,
            cloth=self._cloth.name,
            demonstrator=task.demonstrator,
            physics=PHYSICS if scene is None else scene.physics,
            descriptor=descriptor,
            limits=task.limits,
            cloth_shape=ClothShape(**shape),
            camera=CameraModel(**asdict(pinhole)),
            config={"station": config.name, "stiffness_n_m": config.robot.stiffness_n_m},
        )
        self.cloth_state: ClothState | None = None
        self.commands: list[dict[str, Any]] = []
        """Every command of the episode: time, wanted, sent and measured positions, m world."""
        self._start: Mapping[str, float] = {}
        self._stepped_s = -np.inf
        self._soft = False

    @property
    def spec(self) -> EnvironmentSpec:
        """Properties that are the same in every episode."""
        return self._spec

    def reset(self, seed: int) -> None:
        """Go slowly to the bench's start of this seed, and wait until the cloth hangs still."""
        self.commands.clear()
        home = self.home()
        self.arm.check()
        self._go_home(home)
        self._ready("hang the cloth into the clips")
        if self.scene is not None:
            self.scene.begin(self.corner_positions(), seed)
        self._began_s = self._next_s = self.arm.time_s()
        moves = np.random.default_rng([seed, START_STREAM])
        for _ in range(START_MOVES):
            self.step(moves.uniform(-1.0, 1.0, self.spec.robot.size) * PandaHanger.start_step_m)
        for _ in range(round(SETTLE_S / STEP_S) if self.scene is None else 0):
            self.step(self.spec.robot.zeros())
        self.commands.clear()
        self._began_s = self.arm.time_s()
        x, _, z = self.arm.position()
        self._start = {"holder_x_m": float(x), "holder_z_m": float(z)}

    def _go_home(self, home: FloatArray) -> None:
        """Lead the hanger straight home, slowly and within the limits; StationError where something is in its way."""
        if self._soft:
            self.arm.yield_to_hand(False)
            self._soft = False
        self._set_point, best, waited = self.arm.set_point(), np.inf, 0
        while (away := float(np.linalg.norm(home - self._set_point))) > ARRIVED_M:
            waited = 0 if away < best - ARRIVED_M else waited + 1
            best = min(best, away)
            if waited > BLOCKED_STEPS:
                self.arm.hold()
                raise StationError(
                    f"the arm is blocked {100 * away:.0f} cm before its start: clear its way, then again"
                )
            wanted = self._set_point + (home - self._set_point) * min(1.0, SLOW_M_S * STEP_S / away)
            self._set_point = self._limits.allowed(self._set_point, wanted, self.arm.position(), STEP_S)
            self.arm.move(self._set_point, STEP_S)
            self.arm.wait_until(self.arm.time_s() + STEP_S)

    def home(self) -> FloatArray:
        """Return where the held point is before a start's moves, (3,) m world."""
        return home_corners(self._cloth).mean(axis=0)

    def corner_positions(self) -> FloatArray:
        """Return where the clips hold the corners, (2, 3) m world; row 0 at +y."""
        return corners_at(*self.arm.pose(), self._cloth.held_width_m)

    def observe(self) -> Observation:
        """Return what a policy may see now: the arm's pose, and the newest frame of the step's end."""
        frame = self.camera.frame(after_s=self._stepped_s)
        state = self.perceive(frame)
        return Observation(
            time_s=self.arm.time_s() - self._began_s,
            corner_positions=self.corner_positions(),
            holder_position=self.arm.position(),
            word=state.word,
            word_strength=state.strength,
            contact_portion=min(1.0, state.contact_portion),
            rgb=frame.rgb,
            depth=frame.depth,
            free_edge_m=state.free_edge_m,
        )

    def perceive(self, frame: CameraFrame) -> ClothState:
        """Return the cloth's state in a frame."""
        state = self.cloth_state = self._perception.perceive(frame.rgb, frame.depth)
        return state

    def step(self, action: FloatArray) -> None:
        """Move the set point by ``action``, (2,) m dx and dz, within the limits; returns when the step is over."""
        wanted = self._set_point + self.spec.robot.unpack(action)[0]
        measured = self.arm.position()
        try:
            target = self._limits.allowed(self._set_point, wanted, measured, self._step_s)
        except StationError:
            self.arm.hold()
            raise
        if self._soft:
            self.arm.yield_to_hand(False)
            self._soft = False
        self.arm.move(target, self._step_s)
        self.commands.append(
            {"time_s": self.arm.time_s() - self._began_s, "wanted_m": wanted.tolist(), "sent_m": target.tolist(),
             "measured_m": measured.tolist()}
        )  # fmt: skip
        self._set_point = target
        self._pass_step()

    def _pass_step(self) -> None:
        """Wait for the end of the step by the robot's clock; a step that came late does not shorten the next one."""
        self._next_s = max(self._next_s, self.arm.time_s() - self._step_s) + self._step_s
        self.arm.wait_until(self._next_s)
        self._stepped_s = time.monotonic() - (FRAME_AGE_S if self.scene is None else 0.0)
        if self.scene is not None:
            self.scene.follow(self.arm.path() or [self.arm.position()], self.arm.pose()[1])

    def guide(self, hand_m: FloatArray | None) -> FloatArray:
        """Let a hand move the arm for one step; return the resulting action, (2,) m. ``hand_m`` is not used."""
        if not self._soft:
            self.arm.yield_to_hand(True)
            self._soft = True
            self._set_point = self.arm.position()
        before = self._set_point  # Where the last step ended: what the hand moved between two steps counts as well.
        self._pass_step()
        self._set_point = after = self.arm.position()
        return self.spec.robot.pack(after - before)

    def drag(self, node: int, target_m: FloatArray) -> None:
        """Raise StationError: a real cloth is pulled by hand."""
        raise StationError("a station's cloth cannot be dragged in a picture; pull it by hand")

    def release(self) -> None:
        """Do nothing: there is no drag."""
        return

    def ground_truth(self) -> GroundTruth | None:
        """Return the twin's mesh; None at a real station."""
        return None if self.scene is None else self.scene.ground_truth()

    def disturb(self, disturbance: Any, repeat: int = 0) -> DisturbanceRecord | None:
        """Disturb the twin's cloth; at a real station a person does it, for as long as the phase lasts."""
        if self.scene is not None:
            return self.scene.disturb(disturbance, repeat)
        self._ready("disturb the cloth, then step back")
        return DisturbanceRecord(name=str(getattr(disturbance, "name", disturbance)), first_step=0)

    @property
    def disturbed(self) -> bool:
        """Whether the twin's disturbance still acts."""
        return self.scene is not None and self.scene.disturbed

    @property
    def start(self) -> Mapping[str, float]:
        """Place of the hanger when the episode began."""
        return self._start

    def joint_angles(self) -> FloatArray:
        """Return the joint angles of the arm, (7,) rad."""
        return self.arm.joint_angles()

    def idle(self) -> AbstractContextManager[None]:
        """Keep the camera's pictures coming while no step passes; a real camera needs no help."""
        return nullcontext() if self.scene is None else self.scene.streaming()

    def close(self) -> None:
        """Hold the arm, end control and stop the camera; may be called twice."""
        self.arm.stop()
        self.camera.close()
        if self.scene is not None:
            self.scene.close()


def corners_at(place: FloatArray, axes: FloatArray, held_width_m: float) -> FloatArray:
    """Return the corners (2, 3) m of a hanger at ``place`` (3,) whose hand has ``axes`` (3, 3) as columns."""
    clips = 0.5 * held_width_m * np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    return place - clips @ axes.T  # The hand's y points to -y when it looks down.
