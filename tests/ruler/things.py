"""What lies on the table of a drawn frame: the ground, cloths, other things, an arm; height and colour by the seed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

STEP_M = 0.002
SIDE = 1000
"""The table top is a raster of SIDE x SIDE points, STEP_M apart: 2 m."""
FLOOR_M = -0.7
CLOTHS = ("white", "black", "grey", "coloured", "striped", "checked", "printed", "glossy")
GROUNDS = ("plain", "wooden", "slatted", "coloured", "dotted")
RELIEFS = ("flat", "wrinkled", "folded", "crumpled")
OTHERS = ("empty", "bowl", "bottle", "lying bottle", "box", "book", "hand", "several")
SHAPES = {
    "towel": [(-1, -0.75), (1, -0.75), (1, 0.75), (-1, 0.75)],
    "napkin": [(-1, -1), (1, -1), (1, 1), (-1, 1)],
    "shirt": [
        *[(-0.55, 1), (-0.55, -0.3), (-0.85, 0.0), (-1.1, -0.35), (-0.5, -0.9), (-0.2, -1), (0.2, -1)],
        *[(0.5, -0.9), (1.1, -0.35), (0.85, 0.0), (0.55, -0.3), (0.55, 1)],
    ],
    "shorts": [(-0.7, -0.7), (0.7, -0.7), (1, 0.7), (0.2, 0.75), (0, 0), (-0.2, 0.75), (-1, 0.7)],
}
X, Y = (axis.astype(np.float32) for axis in np.meshgrid(*[(np.arange(SIDE) - SIDE / 2 + 0.5) * STEP_M] * 2))

Field = NDArray[np.float32]


@dataclass
class Top:
    """Raster of the table's top and of all that lies on it."""

    height: Field
    """m."""
    rgb: Field
    """Colour under white light, 0..255."""
    label: NDArray[np.uint8]
    """0 ground, 1 cloth, 2 another thing, 3 an arm."""
    gloss: float = 0.0

    def put(self, where: NDArray[np.bool_], height: Field, rgb: Field, label: int) -> None:
        """Lay a thing there."""
        self.height = np.where(where, height, self.height).astype(np.float32)
        self.rgb = np.where(where[..., None], rgb, self.rgb).astype(np.float32)
        self.label[where] = label


def noise(rng: np.random.Generator, size_m: float) -> Field:
    """Return smooth noise of unit scatter, with spots of about ``size_m``."""
    coarse = max(4, round(SIDE * STEP_M / size_m))
    field = cv2.resize(
        rng.normal(size=(coarse, coarse)).astype(np.float32), (SIDE, SIDE), interpolation=cv2.INTER_CUBIC
    )
    return field / field.std()


def hue(rng: np.random.Generator, saturation: tuple[float, float], value: tuple[float, float]) -> Field:
    """Return a colour (3,) of any hue."""
    color = np.array([[[rng.uniform(0, 360), rng.uniform(*saturation), rng.uniform(*value)]]], np.float32)
    return 255 * cv2.cvtColor(color, cv2.COLOR_HSV2RGB)[0, 0]


def _grey(rng: np.random.Generator, low: float, high: float) -> Field:
    return np.asarray(rng.uniform(low, high) + rng.uniform(-6, 6, 3), np.float32)


def ground(rng: np.random.Generator, kind: str) -> Top:
    """Draw the table, which may end in the picture, over a floor."""
    height = np.zeros((SIDE, SIDE), np.float32)
    angle = rng.uniform(0, math.pi)
    along, across = X * math.cos(angle) + Y * math.sin(angle), Y * math.cos(angle) - X * math.sin(angle)
    plain = np.ones((SIDE, SIDE, 1), np.float32)
    if kind == "plain":
        rgb = plain * _grey(rng, *((190, 230), (110, 170), (40, 80))[rng.integers(3)])
    elif kind in ("wooden", "slatted"):
        pitch, grain = rng.uniform(0.06, 0.14), noise(rng, 0.006)
        grain = cv2.blur(grain, (61, 1)) if abs(math.cos(angle)) > 0.7 else cv2.blur(grain, (1, 61))
        board = rng.normal(size=200)[np.floor(across / pitch).astype(int) % 200]
        base = np.array([(150, 105, 65), (190, 150, 105), (165, 150, 130), (205, 190, 170)][rng.integers(4)])
        rgb = base * (1 + 0.05 * grain / grain.std() + 0.05 * board)[..., None]
        gap = np.abs((across / pitch) % 1 - 0.5) > 0.5 - (0.045 if kind == "slatted" else 0.008)
        rgb = np.where(gap[..., None], rgb * (0.3 if kind == "slatted" else 0.75), rgb)
        height = np.where(gap, -0.02 if kind == "slatted" else 0.0, height)
    else:
        rgb = plain * hue(rng, (0.3, 0.8), (0.4, 0.85))
        if kind == "dotted":
            pitch = rng.uniform(0.02, 0.04)
            dot = np.hypot(along % pitch - pitch / 2, across % pitch - pitch / 2) < 0.2 * pitch
            rgb = np.where(dot[..., None], 0.6 * rgb + 90, rgb)
    rgb = rgb * (1 + rng.uniform(0, 0.03) * noise(rng, 0.02))[..., None]
    if rng.random() < 0.3:  # the table's edge
        off = np.abs(along) > rng.uniform(0.42, 0.7)
        height = np.where(off, FLOOR_M, height)
        rgb = np.where(off[..., None], _grey(rng, 30, 150), rgb)
    return Top(height.astype(np.float32), rgb.astype(np.float32), np.zeros((SIDE, SIDE), np.uint8))


def _inside(shape: str, half: float, u: Field, v: Field) -> NDArray[np.bool_]:
    canvas = np.zeros((512, 512), np.uint8)
    cv2.fillPoly(canvas, [np.rint(np.array(SHAPES[shape]) * 200 + 256).astype(np.int32)], 255)
    to_px = np.float32(200 / half)
    u, v = (np.asarray(axis * to_px + 256, np.float32) for axis in (u, v))
    return cv2.remap(canvas, u, v, cv2.INTER_LINEAR, borderValue=0) > 127


def _colors(rng: np.random.Generator, kind: str, u: Field, v: Field, half: float) -> Field:
    """Return the cloth's colour at its own coordinates, m."""
    base = {
        "white": _grey(rng, 205, 240),
        "black": _grey(rng, 14, 38),
        "grey": _grey(rng, 90, 165),
        "glossy": hue(rng, (0.05, 0.35), (0.6, 0.9)),
        "coloured": hue(rng, (0.4, 0.95), (0.35, 0.9)),
    }.get(kind, _grey(rng, 200, 240) if rng.random() < 0.6 else hue(rng, (0.2, 0.9), (0.3, 0.9)))
    rgb = np.ones((*u.shape, 3), np.float32) * base
    second = _grey(rng, 15, 50) if rng.random() < 0.5 else hue(rng, (0.5, 0.9), (0.3, 0.9))
    if kind == "striped":
        pitch = rng.uniform(0.025, 0.08)
        rgb = np.where((u % pitch < rng.uniform(0.2, 0.6) * pitch)[..., None], second, rgb)
    elif kind == "checked":
        pitch, line = rng.uniform(0.02, 0.06), rng.uniform(0.15, 0.5)
        for axis in (u, v):
            rgb = np.where((axis % pitch < line * pitch)[..., None], 0.5 * rgb + 0.5 * second, rgb)
    elif kind == "printed":
        for _ in range(rng.integers(1, 5)):
            at, size = rng.uniform(-0.4, 0.4, 2) * half, rng.uniform(0.1, 0.45) * half
            spot = np.hypot(u - at[0], v - at[1]) if rng.random() < 0.5 else np.maximum(abs(u - at[0]), abs(v - at[1]))
            rgb = np.where((spot < size)[..., None], hue(rng, (0.3, 0.9), (0.2, 0.95)), rgb)
    if rng.random() < 0.3:  # markers sewn on
        for _ in range(rng.integers(3, 9)):
            spot = np.hypot(*(axis - rng.uniform(-0.85, 0.85) * half for axis in (u, v))) < rng.uniform(0.005, 0.011)
            rgb = np.where(spot[..., None], hue(rng, (0.7, 1), (0.6, 1)), rgb)
    if rng.random() < 0.3:  # a label
        at = rng.uniform(-0.5, 0.5, 2) * half
        label = (abs(u - at[0]) < 0.01) & (abs(v - at[1]) < 0.018)
        rgb = np.where(label[..., None], (235, 235, 230), rgb)
    if rng.random() < 0.4:  # hems
        rim = (np.maximum(abs(u), abs(v) / 0.75) % half) > half - 0.01
        rgb = np.where(rim[..., None], rgb * rng.uniform(0.75, 1.1), rgb)
    return np.asarray(rgb * (1 + 0.015 * noise(rng, 0.005))[..., None], np.float32)


def lay_cloth(rng: np.random.Generator, top: Top, kind: str, relief: str) -> None:
    """Lay a cloth on the table, flat, wrinkled, folded or crumpled."""
    shape = str(rng.choice(list(SHAPES)))
    half, thick = rng.uniform(0.11, 0.22), rng.uniform(0.0015, 0.0045)
    yaw, at = rng.uniform(0, 2 * math.pi), rng.uniform(-0.06, 0.06, 2)
    warp = {"flat": 0.004, "wrinkled": 0.006, "folded": 0.005, "crumpled": 0.022}[relief]
    dx, dy = X - at[0] + warp * noise(rng, 0.1), Y - at[1] + warp * noise(rng, 0.1)
    u, v = dx * math.cos(yaw) + dy * math.sin(yaw), dy * math.cos(yaw) - dx * math.sin(yaw)
    where = _inside(shape, half, u, v)
    height = thick + 0.0004 * noise(rng, 0.05)
    if relief == "folded":
        line = rng.uniform(-0.1, 0.6) * half
        flap = _inside(shape, half, 2 * line - u, v) & (u <= line)
        where = (where & (u <= line)) | flap
        roll = 0.008 * np.exp(-(((line - u) / 0.012) ** 2)) * (u <= line)
        height = height + thick * flap + roll * flap
        u = np.where(flap, 2 * line - u, u)
    elif relief == "wrinkled":
        angle, length = rng.uniform(0, math.pi), rng.uniform(0.04, 0.08)
        wave = 1 + np.sin(2 * math.pi * (X * math.cos(angle) + Y * math.sin(angle)) / length + noise(rng, 0.15))
        height = height + rng.uniform(0.003, 0.08 * length) * wave * np.clip(0.6 + noise(rng, 0.12), 0, 1.2)
    elif relief == "crumpled":
        ridges = sum(np.clip(noise(rng, size) + 0.4, 0, None) * weight for size, weight in ((0.08, 1), (0.03, 0.3)))
        height = height + rng.uniform(0.008, 0.02) * ridges
    top.put(where, height.astype(np.float32), _colors(rng, kind, u, v, half), 1)
    top.gloss = {"glossy": rng.uniform(0.4, 0.9)}.get(kind, 0.0)


def add_thing(rng: np.random.Generator, top: Top, kind: str, *, apart: bool) -> None:
    """Put a thing on the table; ``apart`` is beside the cloth."""
    for _ in range(60):
        at = rng.uniform(-0.4, 0.4, 2) if apart else rng.uniform(-0.12, 0.12, 2)
        yaw, rgb = rng.uniform(0, math.pi), np.ones((SIDE, SIDE, 3), np.float32)
        rgb = rgb * (hue(rng, (0.2, 0.9), (0.2, 0.9)) if rng.random() < 0.6 else _grey(rng, 20, 230))
        dx, dy = X - at[0], Y - at[1]
        u, v = dx * math.cos(yaw) + dy * math.sin(yaw), dy * math.cos(yaw) - dx * math.sin(yaw)
        where, height = _thing(rng, kind, u, v)
        near = cv2.dilate(where.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
        if (top.height[where] > -0.03).all() and not (top.label[near] > 0).any():
            top.put(where, height.astype(np.float32), rgb, 2)
            return


def _thing(rng: np.random.Generator, kind: str, u: Field, v: Field) -> tuple[NDArray[np.bool_], Field]:
    away = np.hypot(u, v)
    if kind == "bowl":
        radius, rise = rng.uniform(0.06, 0.12), rng.uniform(0.05, 0.09)
        return away < radius, 0.01 + (rise - 0.01) * (away / radius) ** 3
    if kind == "bottle":
        return away < rng.uniform(0.03, 0.045), np.where(away < 0.014, rng.uniform(0.18, 0.28), 0.17) + 0 * u
    if kind == "lying bottle":
        radius = rng.uniform(0.03, 0.045)
        return (abs(v) < radius) & (abs(u) < 0.11), radius + np.sqrt(np.clip(radius**2 - v**2, 0, None))
    if kind == "book":
        return (abs(u) < rng.uniform(0.09, 0.14)) & (abs(v) < rng.uniform(0.07, 0.1)), rng.uniform(0.018, 0.04) + 0 * u
    box = rng.uniform(0.03, 0.1, 2)
    return (abs(u) < box[0]) & (abs(v) < box[1]), rng.uniform(0.05, 0.15) + 0 * u


def add_arm(rng: np.random.Generator, top: Top, reach: float) -> None:
    """Let an arm come in from outside until ``reach`` m from the middle."""
    angle = rng.uniform(0, 2 * math.pi)
    u, v = X * math.cos(angle) + Y * math.sin(angle), Y * math.cos(angle) - X * math.sin(angle)
    thick = np.where(u < reach + 0.14, 0.045, 0.033)
    rgb = np.ones((SIDE, SIDE, 3), np.float32) * [(224, 172, 140), (165, 110, 80), (95, 60, 45)][rng.integers(3)]
    round_top = rng.uniform(0.06, 0.12) + 0.5 * np.sqrt(np.clip(thick**2 - v**2, 0, None))
    top.put((u > reach) & (np.abs(v) < thick), round_top.astype(np.float32), rgb.astype(np.float32), 3)
