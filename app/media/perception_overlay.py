"""Pictures of an observation with the perceived contact tinted and WORD as an arrow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from layflat.data.camera import CameraModel
from layflat.data.types import Observation
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.overlay import draw_cloth_state
from layflat.sim.camera.camera import recorded_pinhole

SCALE = 2


class PerceptionOverlay:
    """Draws an observation: its images are perceived again, WORD and contact are those that were recorded."""

    def __init__(self, camera: CameraModel | None = None) -> None:
        """``camera`` has taken the images; the usual one by default."""
        self._camera = recorded_pinhole(camera)
        self._pipeline = PerceptionPipeline(self._camera)

    def __call__(self, observation: Observation) -> NDArray[np.uint8]:
        """Return (H, W, 3) uint8 RGB, twice the camera's size."""
        if observation.rgb is None or observation.depth is None:
            raise ValueError("the observation has no images; record it with images")
        shown = replace(
            self._pipeline.perceive(observation.rgb, observation.depth),
            contact_portion=observation.contact_portion,
            word=observation.word,
            strength=observation.word_strength,
        )
        return draw_cloth_state(observation.rgb, shown, self._camera, scale=SCALE)
