"""Depth images of cloths with any relief under the noise of several sensors, with the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.relief import Relief, measure_relief
from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor

Height = Callable[[NDArray, NDArray], NDArray]
SPAN_M, CELLS = 0.7, 256
XTION_PX_M = 525 * 0.075 / 640
"""Focal length, per pixel of the width, times baseline of an Xtion."""
NOISES = ("stereo", "white", "correlated", "steps", "bands", "resampled")


@dataclass(frozen=True, kw_only=True)
class DepthShot:
    """Depth of a cloth from a camera."""

    camera: PinholeCamera
    depth: NDArray
    """(H, W) m, 0 where missing."""
    cloth: NDArray
    """(H, W) pixels of the cloth."""

    def relief(self) -> Relief:
        return measure_relief(self.camera, self.depth, self.cloth)


def camera_above(tilt=20.0, distance=0.7, width=320) -> PinholeCamera:
    """Return a camera over the origin with the image's right along x."""
    angle, height = math.radians(tilt), width * 3 // 4
    eye = (0.0, -distance * math.sin(angle) - 1e-3, distance * math.cos(angle))
    return PinholeCamera.look_at(eye, (0.0, 0.0, 0.0), width=width, height=height, fx=525 * width / 640)


CAMERAS = (camera_above(), camera_above(0, 0.9, 640), camera_above(35, 0.8, 640), camera_above(10, 1.0, 640))


def waves(*normals_deg: float, amplitude=0.002, wavelength=0.06, rest=0.004) -> Height:
    """Return sine wrinkles, one for each angle of their perpendicular."""

    def height(x, y):
        total = rest
        for number, angle in enumerate(np.radians(normals_deg)):
            along = 2 * math.pi * (x * math.cos(angle) + y * math.sin(angle)) / wavelength
            total = total + amplitude * (1 + np.sin(along + 0.7 + number))
        return total + 0 * x

    return height


def random_relief(rng: np.random.Generator, concentration: float, rms_slope: float) -> Height:
    """Return a random field of wrinkles about 65 mm long; ``concentration`` 0 runs all ways, 3 nearly one way."""
    frequency = np.fft.fftfreq(CELLS, SPAN_M / CELLS)
    fx, fy = np.meshgrid(frequency, frequency)
    size, turn = np.maximum(np.hypot(fx, fy), 1e-9), np.arctan2(fy, fx) - rng.uniform(0, math.pi)
    power = np.exp(-(np.log(size * 0.065) ** 2) / (2 * 0.3**2) + concentration * (np.cos(2 * turn) - 1))
    power[0, 0] = 0
    field = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=power.shape)) * np.sqrt(power)))
    slopes = np.stack(np.gradient(field, SPAN_M / CELLS))
    field *= rms_slope / math.sqrt(np.mean((slopes**2).sum(axis=0)))
    field += 0.003 - field.min()
    scale = CELLS / SPAN_M
    return lambda x, y: map_coordinates(
        field, [(y + SPAN_M / 2) * scale, (x + SPAN_M / 2) * scale], order=1, mode="wrap"
    )


def rectangle(length=0.35, width=0.35, yaw=0.3) -> Callable[[NDArray, NDArray], NDArray]:
    """Return whether a point is on a sheet around the origin."""

    def covers(x, y):
        along, across = x * math.cos(yaw) + y * math.sin(yaw), y * math.cos(yaw) - x * math.sin(yaw)
        return (np.abs(along) <= length / 2) & (np.abs(across) <= width / 2)

    return covers


def shoot(height: Height, covers=None, camera: PinholeCamera = CAMERAS[0]) -> DepthShot:
    """Return the depth of the sheet on its table, without noise."""
    covers = rectangle() if covers is None else covers
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    slopes = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(columns.shape)])
    rays = np.tensordot(camera.cam_to_world[:3, :3], slopes, axes=1)

    def hit(level):
        depth = (level - camera.position[2]) / rays[2]
        return camera.position[0] + depth * rays[0], camera.position[1] + depth * rays[1], depth

    x, y, table = hit(0.0)
    depth = table
    for _ in range(8):
        x, y, depth = hit(height(x, y))
    cloth = covers(x, y)
    return DepthShot(camera=camera, depth=np.where(cloth, depth, table).astype(np.float32), cloth=cloth)


def with_noise(shot: DepthShot, kind: str, seed: int) -> DepthShot:
    """Return the same with the noise of a sensor, 0 to 10 % missing, in whole millimetres."""
    rng, depth = np.random.default_rng(seed), shot.depth
    shape, scale = depth.shape, depth.shape[1] / 640
    if kind == "stereo":  # 1.3 to 5 mm at 1 m
        noise = replace(DepthNoise(), subpixel_px=DepthNoise().subpixel_px * rng.uniform(0.5, 2))
        depth = DepthSensor(noise, seed=seed).measure(depth)
    elif kind == "white":
        depth = depth + rng.uniform(0.001, 0.003) * rng.normal(size=shape)
    elif kind == "correlated":
        depth = depth + rng.uniform(0.0005, 0.0015) * blobs(rng, shape, rng.uniform(2, 8) * scale)
    elif kind == "steps":  # an Xtion's eighths of a pixel
        disparity = XTION_PX_M * shape[1] / depth + 0.05 * blobs(rng, shape, 1.5)
        depth = XTION_PX_M * shape[1] / (np.rint(8 * disparity) / 8)
    elif kind == "bands":
        angle, (rows, columns) = rng.uniform(0, math.pi), np.indices(shape)
        along = (columns * math.cos(angle) + rows * math.sin(angle)) / (rng.uniform(12, 60) * scale)
        depth = depth + rng.uniform(0.0003, 0.0012) * np.sin(2 * math.pi * along) + 0.001 * rng.normal(size=shape)
    elif kind == "resampled":
        coarse = rng.normal(size=(shape[0] // 3, shape[1] // 2)).astype(np.float32)
        depth = depth + rng.uniform(0.001, 0.003) * cv2.resize(coarse, shape[::-1])
    depth = np.where(rng.random(shape) < rng.choice([0, 0.02, 0.1]), 0, depth)
    return replace(shot, depth=np.round(depth, 3).astype(np.float32))


def blobs(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> NDArray:
    """Return noise of unit variance that neighbours share."""
    field = cv2.GaussianBlur(rng.normal(size=shape).astype(np.float32), (0, 0), sigma)
    return field / field.std()


def true_tensor(height: Height, covers) -> tuple[float, float, float]:
    """Return the angle (degrees), the coherence and the rms slope of the relief's own structure tensor."""
    ticks = np.linspace(-0.3, 0.3, 600)
    x, y = np.meshgrid(ticks, ticks)
    across, along = np.gradient(height(x, y), ticks[1] - ticks[0])
    inside = covers(x, y)
    xx, xy, yy = (float(np.mean((a * b)[inside])) for a, b in ((along, along), (along, across), (across, across)))
    double = complex(xx - yy, 2 * xy)
    return math.degrees(math.atan2(double.imag, double.real)) / 2, abs(double) / (xx + yy), math.sqrt(xx + yy)
