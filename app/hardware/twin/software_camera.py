"""SoftwareCamera: librealsense's software device, fed with rendered frames: the same classes as of a real camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.app.hardware.realsense_camera import depth_millimetres, realsense
from layflat.data.camera import CameraModel

FPS = 30
DEPTH_UNIT_M = 0.001


class SoftwareCamera:
    """A depth and a colour sensor whose frames come from a program."""

    def __init__(self, camera: CameraModel) -> None:
        rs = realsense()
        self._rs, self._camera = rs, camera
        self._device = rs.software_device()
        intrinsics = rs.intrinsics()
        intrinsics.width, intrinsics.height = camera.width, camera.height
        intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = camera.fx, camera.fy, camera.cx, camera.cy
        intrinsics.model, intrinsics.coeffs = rs.distortion.none, [0.0] * 5
        self._depth, depth_profile = self._sensor("Depth", rs.stream.depth, rs.format.z16, 2, intrinsics, 0)
        self._depth.add_read_only_option(rs.option.depth_units, DEPTH_UNIT_M)
        self._color, color_profile = self._sensor("Color", rs.stream.color, rs.format.rgb8, 3, intrinsics, 1)
        straight = rs.extrinsics()
        straight.rotation, straight.translation = np.eye(3).ravel().tolist(), [0.0] * 3
        depth_profile.register_extrinsics_to(color_profile, straight)
        self._device.create_matcher(rs.matchers.default)
        self._syncer = rs.syncer()
        for sensor, profile in ((self._depth, depth_profile), (self._color, color_profile)):
            sensor.open(profile)
            sensor.start(self._syncer)
        self._profiles = depth_profile, color_profile
        self._open: tuple[Any, ...] = (self._depth, self._color)
        self.number = 0
        """Number of the last frame."""

    def _sensor(self, name: str, kind: Any, format_: Any, bpp: int, intrinsics: Any, index: int) -> tuple[Any, Any]:
        sensor = self._device.add_sensor(name)
        stream = self._rs.video_stream()
        stream.type, stream.index, stream.uid, stream.fmt = kind, 0, index, format_
        stream.width, stream.height, stream.fps, stream.bpp = intrinsics.width, intrinsics.height, FPS, bpp
        stream.intrinsics = intrinsics
        return sensor, sensor.add_video_stream(stream).as_video_stream_profile()

    def feed(self, rgb: NDArray[np.uint8], depth: NDArray[np.float32], *, number: int | None = None) -> None:
        """Send a frame, (H, W, 3) and (H, W) m; ``number`` repeats one, as frozen cameras do."""
        self.number = self.number + 1 if number is None else number
        frames = ((self._depth, depth_millimetres(depth), 2), (self._color, np.ascontiguousarray(rgb), 3))
        for (sensor, pixels, bpp), profile in zip(frames, self._profiles, strict=True):
            frame = self._rs.software_video_frame()
            frame.pixels = pixels
            frame.stride, frame.bpp = self._camera.width * bpp, bpp
            frame.timestamp, frame.frame_number = self.number * 1000.0 / FPS, self.number
            frame.domain, frame.profile = self._rs.timestamp_domain.hardware_clock, profile
            sensor.on_video_frame(frame)

    def poll(self) -> Any:
        """Return the next frameset of both sensors, or None."""
        frames = self._syncer.poll_for_frames()
        complete = frames and frames.size() >= 2
        return frames if complete else None

    def close(self) -> None:
        """Stop both sensors; may be called twice."""
        sensors, self._open = self._open, ()
        for sensor in sensors:
            sensor.stop()
            sensor.close()

    def opener(self) -> tuple[Callable[[], Any], Callable[[], None]]:
        """Return what `layflat.app.hardware.realsense_camera.RealSenseCamera` asks for."""
        return self.poll, self.close
