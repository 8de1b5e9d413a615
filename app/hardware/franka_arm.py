"""FrankaArm: a Franka arm under Cartesian impedance, driven over the robot's own protocol (libfranka, by franky).

A thread sends the set point and its speed a hundred times a second along straight lines, so that the controller gets a
smooth path from commands that come ten times a second. Without a new command it holds the last one.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from layflat.app.hardware.station_config import RobotConfig, StationError
from layflat.app.support.errors import UsageError
from layflat.data.arrays import FloatArray

STREAM_S = 0.01
POLL_S = 0.001
NEWS_S = 0.2
"""Wall time without a new state after which the robot's clock counts as standing, however busy this machine is."""
LOAD_INERTIA = (1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3)
MAX_TILT_DEG = 5.0
"""Where the hand points elsewhere by more, the springs would turn it at once: that is for a person to do."""
INTEGRAL_PER_S = 3.0
"""At 400 N/m friction and unknown loads of 10 N hold the hand 2.5 cm back: this takes up what stays of the error."""
DOWN = np.diag([1.0, -1.0, -1.0])
"""The hand's axes in the world when it points straight down and its bar lies along y."""
BIAS_SHARE = 0.5
"""Most of the allowed force that the integral may use."""


class FrankaArm:
    """A connected arm with the hanger in its hand, whose held point moves in the table's frame."""

    def __init__(self, config: RobotConfig) -> None:
        franky = _franky()
        self._config, self._franky = config, franky
        self._yaw = _about_z(config.base_yaw_deg)
        mode = franky.RealtimeConfig.Enforce if config.realtime else franky.RealtimeConfig.Ignore
        with self._errors(f"no robot answers at {config.host}"):
            self._robot = franky.Robot(config.host, realtime_config=mode)
            if self._robot.has_errors:
                self._robot.recover_from_errors()
            self._robot.set_collision_behavior([60.0] * 7, [max(40.0, 2 * config.force_n)] * 6)
            if config.load_kg:
                self._robot.set_load(config.load_kg, [0.0, 0.0, config.tool_m], LOAD_INERTIA)
        self._tracker: Any = None
        self._thread: threading.Thread | None = None
        self._stop, self._lock = threading.Event(), threading.Lock()
        self._fault: str | None = None
        self._path: list[tuple[float, FloatArray]] = []
        self._segment = (0.0, np.zeros(3), np.zeros(3), 0.0)

    def start_control(self) -> None:
        """Switch to impedance control where the arm is now; it holds."""
        config = self._config
        self._straight_down()
        tilt = self._tilt_deg()
        if tilt > MAX_TILT_DEG:
            raise StationError(
                f"the hand is turned by {tilt:.0f} degrees from straight down with its bar along y; guide it to within "
                f"{MAX_TILT_DEG:g} by hand"
            )
        with self._errors("the robot does not take control"):
            self._fault = None
            self._tracker = self._franky.CartesianImpedanceTracker(
                self._robot,
                translational_stiffness=config.stiffness_n_m,
                rotational_stiffness=config.rotational_stiffness_n_m,
            )
        here = self.position()
        self._segment = (self.time_s(), here, np.zeros(3), 0.0)
        self._bias = np.zeros(3)
        self._stop.clear()
        self._thread = threading.Thread(target=self._stream, name="franka-stream", daemon=True)
        self._thread.start()

    def _straight_down(self) -> None:
        """Keep the attitude in which the bar is level and along y."""
        turn = np.eye(4)
        turn[:3, :3] = self._yaw.T @ DOWN
        self._attitude = self._franky.Affine(turn).quaternion

    def _tilt_deg(self) -> float:
        """Return the angle between the hand and the attitude that control would keep."""
        cosine = (np.trace(DOWN.T @ self.pose()[1]) - 1.0) / 2.0
        return float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def move(self, target: FloatArray, duration_s: float) -> None:
        """Lead the set point to ``target``, (3,) m world, evenly in ``duration_s`` of the robot's time."""
        self.check()
        start = self.set_point()
        with self._lock:
            self._segment = (self.time_s(), start, (target - start) / duration_s, duration_s)
            self._path.clear()

    def hold(self) -> None:
        """Hold where the set point is now."""
        here = self.set_point()
        with self._lock:
            self._segment = (self.time_s(), here, np.zeros(3), 0.0)

    def yield_to_hand(self, soft: bool) -> None:
        """Let a hand move the arm in x and z, or hold again where it is."""
        gains = self._franky.CartesianImpedanceGains()
        k, turn = self._config.stiffness_n_m, self._config.rotational_stiffness_n_m
        gains.stiffness = np.diag([0.0, k, 0.0, turn, turn, turn] if soft else [k, k, k, turn, turn, turn])
        if soft:
            gains.damping = np.diag([8.0, 40.0, 8.0, 12.0, 12.0, 12.0])
        else:
            here = self.position()
            with self._lock:
                self._segment = (self.time_s(), here, np.zeros(3), 0.0)
        with self._errors("the robot refuses other gains"):
            self._tracker.set_gains(gains=gains)

    def set_point(self) -> FloatArray:
        """Return where the springs pull the held point now, (3,) m world."""
        start_s, start, velocity, duration = self._segment
        return start + velocity * min(max(self.time_s() - start_s, 0.0), duration)

    def position(self) -> FloatArray:
        """Return where the corners' midpoint is, (3,) m world."""
        return self.pose()[0]

    def pose(self) -> tuple[FloatArray, FloatArray]:
        """Return the corners' midpoint (3,) m and the hand's axes (3, 3) as columns, world."""
        matrix = np.array(self._state().O_T_EE.matrix)
        axes = self._yaw @ matrix[:3, :3]
        place = np.array(self._config.base_m) + self._yaw @ matrix[:3, 3] + axes[:, 2] * self._config.tool_m
        return place, axes

    def joint_angles(self) -> FloatArray:
        """Return the joint angles, (7,) rad."""
        return np.array(self._state().q)

    def time_s(self) -> float:
        """Return the robot's clock."""
        return float(self._state().time.to_sec())

    def _state(self) -> Any:
        with self._errors("the connection to the robot is lost"):
            return self._robot.state

    def path(self) -> list[FloatArray]:
        """Return where the held point has been since the last command, (3,) m each, oldest first."""
        with self._lock:
            return [place for _, place in self._path]

    def wait_until(self, time_s: float) -> None:
        """Wait for the robot's clock; StationError where it stops."""
        last, seen = self.time_s(), time.monotonic()
        limit = max(self._config.watchdog_s, NEWS_S)
        while last < time_s:
            self.check()
            time.sleep(POLL_S)
            now = self.time_s()
            if now > last:
                last, seen = now, time.monotonic()
            elif time.monotonic() - seen > limit:
                self._fault = self._fault or f"the robot has sent nothing for {limit:g} s"
                self.check()

    def check(self) -> None:
        """Raise StationError where control has ended, with the reason."""
        if self._fault is None and self._tracker is not None and not self._tracker.is_running:
            self._fault = self._reason()
        if self._fault is not None:
            raise StationError(f"the arm has stopped: {self._fault}")

    def _reason(self) -> str:
        """Return why control ended, in the robot's words."""
        try:
            self._robot.poll_motion()
        except Exception as error:
            return " ".join(str(error).split())[:200]
        errors = self._state().last_motion_errors
        return f"reflex {errors}" if self._robot.has_errors else "the controller ended"

    def _stream(self) -> None:
        affine, twist = self._franky.Affine, self._franky.Twist
        up = np.array([0.0, 0.0, self._config.tool_m])
        limit = BIAS_SHARE * self._config.force_n / self._config.stiffness_n_m
        last = self.time_s()
        try:
            while not self._stop.wait(STREAM_S):
                if not self._tracker.is_running:
                    self._fault = self._fault or self._reason()
                    return
                place = self.position()
                now = self.time_s()
                with self._lock:
                    start_s, start, velocity, duration = self._segment
                    self._path.append((now, place))
                moving = 0.0 <= now - start_s < duration
                target = start + velocity * min(max(now - start_s, 0.0), duration)
                self._bias = np.clip(
                    self._bias + INTEGRAL_PER_S * max(now - last, 0.0) * (target - place), -limit, limit
                )
                last = now
                local = self._yaw.T @ (target + self._bias + up - np.array(self._config.base_m))
                speed = self._yaw.T @ (velocity if moving else np.zeros(3))
                self._tracker.set_target(affine(local, self._attitude), twist(speed, np.zeros(3)))
        except Exception as error:
            self._fault = self._fault or " ".join(str(error).split())[:200]

    def recover(self) -> str:
        """Recover from a reflex, and return what happened."""
        what = self._fault or "nothing"
        self.stop()
        with self._errors("the robot does not recover"):
            self._robot.recover_from_errors()
        self.start_control()
        return what

    def stop(self) -> None:
        """End control; the arm comes to rest. May be called twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(2.0)
            self._thread = None
        if self._tracker is not None:
            with contextlib.suppress(Exception):
                self._tracker.stop()
            self._tracker = None

    @contextlib.contextmanager
    def _errors(self, what: str) -> Iterator[None]:
        try:
            yield
        except (self._franky.Exception, RuntimeError) as error:
            raise StationError(f"{what}: {' '.join(str(error).split())[:200]}") from None


def _franky() -> Any:
    try:
        import franky
    except ImportError:
        raise UsageError("the station needs its libraries; install layflat[station]") from None
    return franky


def _about_z(degrees: float) -> FloatArray:
    angle = np.deg2rad(degrees)
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
