"""Drawn RGB-D frames with the true mask: everything about frame ``seed`` is decided by the seed.

A table top with relief is ray-cast by any camera; lamp, shadows, gloss, exposure, sensor noise and holes follow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.tests.ruler import things
from layflat.tests.ruler.things import FLOOR_M, SIDE, STEP_M, Top
from layflat.tests.scenes import _add_depth_errors, stand

SIZES = ((640, 480), (640, 480), (424, 240), (848, 480))
LEVELS = np.concatenate([np.arange(0.30, 0.06, -0.01), np.arange(0.06, -0.001, -0.002), [-0.01, -0.021, FLOOR_M]])
MIN_CONTRAST = 40.0
"""Smallest difference of any channel between most of a flat cloth and the ground; others: half."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """Drawn frame and the truth about it."""

    seed: int
    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    """m; 0, 65.535 or NaN where there is no value."""
    true_depth: NDArray[np.float32]
    cloth: NDArray[np.bool_]
    """Visible cloth."""
    camera: PinholeCamera
    lens: Intrinsics
    kind: str
    """Kind of cloth, or ``none``."""
    ground: str
    relief: str
    """Relief of the cloth, or what is there instead."""
    beside: str
    """``alone``, ``clutter`` or ``hand``."""


def draw(seed: int, *, cloth: bool = True) -> Frame:
    """Draw the frame of a seed, with one cloth or with none."""
    rng = np.random.default_rng([seed, cloth])
    kind, relief = str(rng.choice(things.CLOTHS)), str(rng.choice(things.RELIEFS))
    beside = str(rng.choice(["alone", "clutter", "hand"], p=[0.5, 0.35, 0.15])) if cloth else "alone"
    if not cloth:
        kind, relief = "none", str(rng.choice(things.OTHERS))
    while True:
        name = str(rng.choice(things.GROUNDS))
        top = things.ground(rng, name)
        under = top.rgb.copy()
        if cloth:
            things.lay_cloth(rng, top, kind, relief)
        else:
            for _ in range({"empty": 0, "hand": 0, "several": 4}.get(relief, 1)):
                thing = str(rng.choice(things.OTHERS[1:6])) if relief == "several" else relief
                things.add_thing(rng, top, thing, apart=relief == "several")
        if beside == "clutter":
            for _ in range(rng.integers(1, 5)):
                things.add_thing(rng, top, str(rng.choice(things.OTHERS[1:6])), apart=True)
        if beside == "hand" or relief == "hand":
            things.add_arm(rng, top, rng.uniform(0.04, 0.16))
        camera, lens = _camera(rng)
        x, y, depth = _cast(camera, top.height)
        label = _look(top.label, x, y, nearest=True)
        seen = (label == 1) & (depth > 0)
        rim = np.concatenate([seen[:3].ravel(), seen[-3:].ravel(), seen[:, :3].ravel(), seen[:, -3:].ravel()])
        if cloth and (rim.any() or seen.mean() < 0.02 or not _differs(top, under, relief)):
            continue
        if not cloth and relief not in ("empty", "hand") and not (label == 2).any():
            continue
        break
    rgb = _light(rng, top, x, y, depth)
    noisy = _sense(rng, depth, seen & (kind in ("black", "glossy")))
    return Frame(
        seed=seed, rgb=rgb, depth=noisy, true_depth=depth.astype(np.float32), cloth=seen, camera=camera, lens=lens,
        kind=kind, ground=name, relief=relief, beside=beside,
    )  # fmt: skip


def _differs(top: Top, under: NDArray, relief: str) -> bool:
    """Whether most of the cloth has another colour than the ground under it."""
    where = top.label == 1
    difference = np.abs(top.rgb - np.median(under[where], axis=0)).max(axis=-1)[where]
    wanted = MIN_CONTRAST if relief == "flat" else 0.5 * MIN_CONTRAST
    return bool(np.mean(difference > wanted) > (0.9 if relief == "flat" else 0.6)) or _patterned(difference)


def _patterned(difference: NDArray) -> bool:
    """Whether a good part differs strongly: a pattern whose ground has the table's colour is no harder for a person."""
    return bool(np.mean(difference > 2 * MIN_CONTRAST) > 0.3)


def _camera(rng: np.random.Generator) -> tuple[PinholeCamera, Intrinsics]:
    width, height = SIZES[rng.integers(len(SIZES))]
    roll = rng.uniform(0, 360) if rng.random() < 0.4 else rng.uniform(-15, 15)
    tilt = rng.uniform(0, 12) if rng.random() < 0.4 else rng.uniform(12, 48)
    return stand(tilt=tilt, roll=roll, distance=rng.uniform(0.65, 1.1), width=width, height=height)


def _look(raster: NDArray, x: NDArray, y: NDArray, *, nearest: bool = False, outside: float = 0.0) -> NDArray:
    u, v = (np.clip(axis / STEP_M + SIDE / 2 - 0.5, -9, SIDE + 9).astype(np.float32) for axis in (x, y))
    way = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return cv2.remap(raster, u, v, way, borderMode=cv2.BORDER_CONSTANT, borderValue=(outside,) * 3)


def _cast(camera: PinholeCamera, height: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return x, y, m, and depth, m, of the first point of the relief that each pixel's ray meets; depth 0: none."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    slopes = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(columns.shape)])
    rays = np.tensordot(camera.cam_to_world[:3, :3], slopes, axes=1).astype(np.float32)
    down = np.minimum(rays[2], -1e-3)
    z_hit = np.full(columns.shape, np.float32(FLOOR_M))
    above, before = np.full(columns.shape, np.float32(1.0)), np.float32(LEVELS[0] + 0.01)
    open_ = np.ones(columns.shape, bool)
    for level in LEVELS:
        depth = (np.float32(level) - camera.position[2]) / down
        gap = level - _look(
            height, camera.position[0] + depth * rays[0], camera.position[1] + depth * rays[1], outside=FLOOR_M
        )
        hit = open_ & (gap <= 0)
        share = np.clip(above / np.maximum(above - gap, 1e-6), 0, 1)
        z_hit[hit] = (before + share * (level - before))[hit]
        open_ &= ~hit
        above, before = np.where(open_, gap, above), np.float32(level)
    depth = (z_hit - camera.position[2]) / down
    depth = np.where((rays[2] < -0.02) & (depth < 6), depth, 0)
    return camera.position[0] + depth * rays[0], camera.position[1] + depth * rays[1], depth


def _light(rng: np.random.Generator, top: Top, x: NDArray, y: NDArray, depth: NDArray) -> NDArray[np.uint8]:
    """Return the picture: Lambert, cast and foreign shadows, gloss, falling-off light, white balance, noise, JPEG."""
    azimuth, rise = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(35, 80))
    lamp = np.array([math.cos(azimuth) * math.cos(rise), math.sin(azimuth) * math.cos(rise), math.sin(rise)])
    relief = cv2.GaussianBlur(top.height, (0, 0), 1.0)
    gy, gx = np.gradient(np.where(top.height < -0.5, 0, relief), STEP_M)
    norm = np.sqrt(1 + gx**2 + gy**2)
    facing = np.clip((lamp[2] - gx * lamp[0] - gy * lamp[1]) / norm, 0, None)
    shadow = np.zeros((SIDE, SIDE), bool)
    for away in np.arange(2, 120, 3):  # raster points towards the lamp
        shift = np.array([[1, 0, -away * lamp[0] / math.cos(rise)], [0, 1, -away * lamp[1] / math.cos(rise)]])
        there = cv2.warpAffine(top.height, shift.astype(np.float32), (SIDE, SIDE))
        shadow |= there > top.height + away * STEP_M * math.tan(rise) + 0.001
    lit = facing * (1 - cv2.GaussianBlur(shadow.astype(np.float32), (0, 0), 2.0))
    if rng.random() < 0.3:  # someone's shadow, or a sun spot
        lit = lit * (1 + rng.choice([-0.6, 0.5]) / (1 + np.exp(-14 * (things.noise(rng, 0.5) - 0.8))))
    ambient = rng.uniform(0.35, 0.65)
    half_way = lamp + np.array([0.0, 0.0, 1.0])
    half_way /= np.linalg.norm(half_way)
    mirror = (half_way[2] - gx * half_way[0] - gy * half_way[1]) / norm
    color = top.rgb * (ambient + (1 - ambient) * lit)[..., None]
    color = color + (255 * top.gloss * np.clip(mirror, 0, 1) ** 60 * (top.label == 1) * (1 - shadow))[..., None]
    image = _look(color.astype(np.float32), x, y, outside=90.0)
    image = np.where((depth > 0)[..., None], image, 120.0)
    rows, columns = (np.linspace(-1, 1, size) for size in image.shape[:2])
    fall = 1 + rng.uniform(-0.18, 0.18) * columns[None, :] + rng.uniform(-0.18, 0.18) * rows[:, None]
    image = cv2.GaussianBlur(image, (3, 3), 0.6) * fall[..., None] * rng.uniform(0.75, 1.1) * rng.uniform(0.93, 1.07, 3)
    picture = np.clip(np.rint(image + rng.normal(0, rng.uniform(1, 4), image.shape)), 0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        packed = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(60, 96))])[1]
        picture = np.ascontiguousarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1])
    return picture


def _sense(rng: np.random.Generator, depth: NDArray, dull: NDArray) -> NDArray[np.float32]:
    """Return what a depth camera gives of it: also bent by a millimetre or two, with more holes on ``dull`` pixels."""
    small = rng.normal(size=(4, 5)).astype(np.float32)
    bent = depth + 0.001 * cv2.resize(small, depth.shape[::-1], interpolation=cv2.INTER_CUBIC) * (depth > 0)
    noisy = _add_depth_errors(bent, rng, rng.uniform(0.001, 0.003), rng.uniform(0.005, 0.12))
    if dull.any():
        blots = cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), 3.0)
        noisy = np.where(dull & (blots < np.quantile(blots, rng.uniform(0, 0.4))), 0, noisy)
    missing = rng.choice([0.0, 0.0, 65.535, np.nan])
    return np.where(noisy > 0, noisy, missing).astype(np.float32)
