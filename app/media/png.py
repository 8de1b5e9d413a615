"""Images as PNG files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.data.atomic_files import write_bytes


def write_png(path: Path, image: NDArray[np.uint8]) -> None:
    """Write (H, W, 3) RGB to ``path``, whole or not at all."""
    # OpenCV is given no path: it crashes on one that is not UTF-8.
    write_bytes(path, png_bytes(image))


def png_bytes(image: NDArray[np.uint8]) -> bytes:
    """Return (H, W, 3) RGB as the bytes of a PNG."""
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return encoded.tobytes()
