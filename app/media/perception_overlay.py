"""Pictures of an observation with what perception makes of it: contact tinted, WORD as an arrow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from layflat.data.types import Observation
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.overlay import draw_cloth_state
from layflat.sim.camera.camera import default_pinhole

SCALE = 2


class PerceptionOverlay:
    """Perceives an observation's own images again and draws them, with the WORD and contact that were recorded."""

    def __init__(self) -> None:
        self._camera = default_pinhole()
        self._perceiver = PerceptionPipeline(self._camera)

    def __call__(self, observation: Observation) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 RGB, twice the camera's size."""
        if observation.rgb is None or observation.depth is None:
            raise ValueError("the observation has no images; record it with images")
        cloth_state = self._perceiver.perceive(observation.rgb, observation.depth)
        shown = replace(
            cloth_state,
            contact_portion=observation.contact_portion,
            word=observation.word,
            strength=observation.word_strength,
        )
        return draw_cloth_state(observation.rgb, shown, self._camera, scale=SCALE)
