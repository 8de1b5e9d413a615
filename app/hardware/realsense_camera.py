"""RealSenseCamera: aligned colour and depth of a RealSense camera, of a recording of one, or of its software twin."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.app.hardware.station_config import CameraConfig, StationError
from layflat.app.support.errors import UsageError
from layflat.perception.camera.intrinsics import Intrinsics

POLL_S = 0.001
FIRST_FRAME_S = 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraFrame:
    """One aligned frame."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth: NDArray[np.float32]
    """(H, W) m along the optical axis; 0 where there is none."""
    number: int
    """Counted by the camera."""
    time_s: float
    """The camera's clock."""
    seen_s: float
    """This machine's monotonic clock when the frame came."""


class RealSenseCamera:
    """Colour and depth, aligned to the colour; the newest frame is what counts. A thread notes when frames come."""

    def __init__(self, poll: Callable[[], Any], close: Callable[[], None], config: CameraConfig) -> None:
        """Use `open_camera`; ``poll`` returns the next frameset of librealsense, or None where there is none yet."""
        rs = realsense()
        self._poll, self._close, self._config = poll, close, config
        self._align = rs.align(rs.stream.color)
        self._arrived: tuple[Any, float] | None = None
        self._last_number = 0
        self._newest: CameraFrame | None = None
        self.dropped = 0
        """Frames that the camera counted and that never came."""
        self.repeated = 0
        """Frames in a row that are the last one again."""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._read, name="camera", daemon=True)
        self._thread.start()
        self.intrinsics = self._wait_for_first()

    def frame(self, *, after_s: float = -np.inf) -> CameraFrame:
        """Return the newest frame, at least as new as ``after_s`` on this machine's monotonic clock.

        StationError where none comes in time: the camera is unplugged, or its pictures are frozen.
        """
        give_up = time.monotonic() + self._config.stale_s
        while True:
            self._take()
            newest = self._newest
            if newest is not None and newest.seen_s >= max(after_s, time.monotonic() - self._config.stale_s):
                return newest
            if time.monotonic() > give_up:
                why = "its pictures are frozen" if self.repeated else "is it unplugged?"
                raise StationError(f"the camera has sent no new frame for {self._config.stale_s:g} s: {why}")
            time.sleep(POLL_S)

    def close(self) -> None:
        """Stop the camera; may be called twice."""
        self._over.set()
        self._thread.join()
        close, self._close = self._close, lambda: None
        close()

    def _read(self) -> None:
        while not self._over.wait(POLL_S):
            frames = self._poll()
            if frames is None:
                continue
            number = int(frames.get_color_frame().get_frame_number())
            if number > self._last_number:
                self.dropped += number - self._last_number - 1 if self._last_number else 0
                self._last_number = number
            self._arrived = frames, time.monotonic()

    def _take(self) -> None:
        """Decode what has come since the last call; only the newest counts."""
        arrived, self._arrived = self._arrived, None
        if arrived is None:
            return
        frames, seen_s = arrived
        aligned = self._align.process(frames)
        color, depth_frame = aligned.get_color_frame(), aligned.get_depth_frame()
        if not color or not depth_frame:
            return
        depth = np.asanyarray(depth_frame.get_data()).astype(np.float32) * np.float32(depth_frame.get_units())
        number = int(color.get_frame_number())
        last = self._newest
        if last is not None and (number <= last.number or np.array_equal(depth, last.depth)):
            self.repeated += 1  # No two pictures of a real sensor have the same noise.
            return
        self.repeated = 0
        self._newest = CameraFrame(
            rgb=np.array(np.asanyarray(color.get_data())[..., :3]),
            depth=depth,
            number=number,
            time_s=float(color.get_timestamp()) / 1000.0,
            seen_s=seen_s,
        )
        self._profile = color.profile.as_video_stream_profile()

    def _wait_for_first(self) -> Intrinsics:
        give_up = time.monotonic() + FIRST_FRAME_S
        while self._newest is None:
            self._take()
            if time.monotonic() > give_up:
                self._over.set()
                raise StationError(f"the camera has sent no frame for {FIRST_FRAME_S:g} s: is it plugged in?")
            time.sleep(POLL_S)
        seen = self._profile.get_intrinsics()
        return Intrinsics(width=seen.width, height=seen.height, fx=seen.fx, fy=seen.fy, cx=seen.ppx, cy=seen.ppy)


def open_camera(config: CameraConfig) -> RealSenseCamera:
    """Open the camera of a station file, or its recording; exposure and white balance are locked after a warm-up."""
    rs = realsense()
    pipeline, wanted = rs.pipeline(), rs.config()
    if config.bag:
        wanted.enable_device_from_file(config.bag, repeat_playback=False)
    else:
        if config.serial:
            wanted.enable_device(config.serial)
        wanted.enable_stream(rs.stream.color, config.width, config.height, rs.format.rgb8, config.fps)
        wanted.enable_stream(rs.stream.depth, config.width, config.height, rs.format.z16, config.fps)
    try:
        profile = pipeline.start(wanted)
    except RuntimeError as error:
        what = config.bag or (f"camera {config.serial}" if config.serial else "a RealSense camera")
        raise StationError(f"{what} cannot be opened: {error}") from None

    def poll() -> Any:
        frames = pipeline.poll_for_frames()
        return frames if frames and frames.get_color_frame() and frames.get_depth_frame() else None

    camera = RealSenseCamera(poll, pipeline.stop, config)
    if not config.bag:
        _lock_exposure(rs, profile, camera, config)
    return camera


def _lock_exposure(rs: Any, profile: Any, camera: RealSenseCamera, config: CameraConfig) -> None:
    """Keep what the automatics found: a cloth that moves must not change the colours of the rest."""
    for _ in range(config.warm_up_frames):
        camera.frame(after_s=time.monotonic())
    for sensor in profile.get_device().query_sensors():
        for option in (rs.option.enable_auto_exposure, rs.option.enable_auto_white_balance):
            if sensor.supports(option):
                sensor.set_option(option, 0.0)


def depth_millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return depth as a camera sends it, whole millimetres."""
    return np.clip(np.round(depth * 1000.0), 0, 65535).astype(np.uint16)


def realsense() -> Any:
    """Return librealsense's module; UsageError where it is not installed."""
    try:
        import pyrealsense2
    except ImportError as error:  # Also where libusb of the system is missing.
        raise UsageError(f"the station's camera needs its library; install layflat[station] ({error})") from None
    return pyrealsense2
