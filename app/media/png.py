"""Images as PNG files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.support.errors import LayflatError
from layflat.data.atomic_files import atomic_path


def write_png(path: Path, image: NDArray[np.uint8]) -> None:
    """Write (H, W, 3) RGB to ``path``, whole or not at all."""
    with atomic_path(path) as part:
        if not cv2.imwrite(str(part), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)):
            raise LayflatError(f"{path} could not be written as a PNG file; check the disk")
