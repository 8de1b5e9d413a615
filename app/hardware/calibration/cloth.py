"""How the cloth looks when it lies flat: its colour, and P_flat of Eq. 4-7."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layflat.app.support.errors import UsageError
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.color_calibration import learn_hsv
from layflat.perception.cloth.pipeline import PerceptionConfig, PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange
from layflat.sim.cloth.spec import ClothSpec

AREA_TOLERANCE = 0.15
"""A flat cloth's seen area may differ from its file's by this share."""


@dataclass(frozen=True, kw_only=True)
class ClothCalibration:
    """Colour and area of the flat cloth."""

    color: HsvRange
    flat_pixels: int
    area_m2: float
    contact_portion: float
    """Share of it that the camera takes for lying on the table: near 1, or it does not lie flat."""


def calibrate_cloth(
    rgb: NDArray[np.uint8],
    depth: NDArray[np.float32],
    camera: PinholeCamera,
    cloth: ClothSpec,
    at: tuple[int, int] | None = None,
) -> ClothCalibration:
    """Measure the cloth, laid flat by hand, in one frame; ``at`` (column, row) is on it, by default the centre.

    UsageError where the seen area is not that of the cloth: another one, or it is not flat.
    """
    color = learn_hsv(rgb, at or (rgb.shape[1] // 2, rgb.shape[0] // 2))
    config = PerceptionConfig(color=color)
    state = PerceptionPipeline(camera, config).perceive(rgb, depth)
    area = state.cloth_pixels * (config.grid.mm_per_px / 1000.0) ** 2
    wanted = cloth.length_m * cloth.width_m
    if abs(area - wanted) > AREA_TOLERANCE * wanted:
        raise UsageError(
            f"the cloth in the picture has {1e4 * area:.0f} cm2, {cloth.name} has {1e4 * wanted:.0f}: lay it flat, "
            "whole in the picture, or name its cloth in the station file"
        )
    return ClothCalibration(
        color=color,
        flat_pixels=state.cloth_pixels,
        area_m2=area,
        contact_portion=state.contact_pixels / max(1, state.cloth_pixels),
    )
