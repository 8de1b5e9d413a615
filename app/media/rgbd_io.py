"""RGB-D frames from two PNG files: colour with 8 bits, depth with 16 bits and one channel."""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from layflat.app.support import validators
from layflat.app.support.errors import UsageError

MAX_PIXELS = 50_000_000
"""A D435's largest image has 2 million pixels; a larger file is not a camera frame and is not decoded."""
DECODE_ERRORS = (OSError, SyntaxError, ValueError, LookupError, struct.error, zlib.error, cv2.error)


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Read a colour PNG as (H, W, 3) uint8 RGB; transparency is dropped. UsageError for anything else."""
    mode, pixels = _read(path, "a colour picture as PNG")
    if mode in ("1", "L", "LA") or pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise UsageError(
            f"{path} is grey ({_kind(pixels)}); a colour picture with 3 channels is needed: is it the depth?"
        )
    if pixels.dtype != np.uint8:
        raise UsageError(f"{path} has {_kind(pixels)}; a colour picture with 8 bits is needed")
    return np.ascontiguousarray(pixels[..., 2::-1])  # OpenCV's order is blue, green, red


def read_depth(path: Path, scale_mm: float = 1.0) -> NDArray[np.float32]:
    """Read a 16-bit PNG in units of ``scale_mm`` as (H, W) float32 m, 0 where missing. UsageError for anything else."""
    if not (math.isfinite(scale_mm) and 0 < scale_mm <= 1000):
        raise UsageError(f"--depth-scale is {scale_mm:g}; it must be the millimetres of one unit, such as 1 or 0.25")
    mode, pixels = _read(path, "a depth image as PNG with 16 bits")
    if pixels.ndim != 2 or mode == "LA":
        raise UsageError(
            f"{path} has {_kind(pixels)}; depth has one channel: save the sensor's values, not a picture of them"
        )
    if pixels.dtype != np.uint16:
        raise UsageError(
            f"{path} has {_kind(pixels)}; depth needs 16 bits, whole millimetres: 8 bits lose the millimetres"
        )
    if not pixels.any():
        raise UsageError(f"{path} is 0 everywhere: it holds no depth at all")
    return np.asarray(pixels * np.float32(scale_mm / 1000), dtype=np.float32)


def check_same_size(rgb_path: Path, rgb: NDArray[Any], depth_path: Path, depth: NDArray[Any]) -> None:
    """Raise UsageError unless both have the same size."""
    if rgb.shape[:2] != depth.shape:
        raise UsageError(
            f"{rgb_path} is {rgb.shape[1]}x{rgb.shape[0]} px and {depth_path} {depth.shape[1]}x{depth.shape[0]} px; "
            "save depth that is aligned to the colour picture"
        )


def _read(path: Path, what: str) -> tuple[str, NDArray[Any]]:
    """Return Pillow's mode and OpenCV's pixels of a PNG, unchanged, after a check of its header and checksums."""
    validators.readable_file(path, what)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about the size, which is checked here
            with Image.open(path) as image:
                kind, mode, (width, height) = image.format, image.mode, image.size
            if kind == "PNG" and width * height <= MAX_PIXELS:
                _decode_with_pillow(path)
    except Image.DecompressionBombError as error:
        raise UsageError(f"{path} has more than {MAX_PIXELS // 10**6} million pixels; no camera frame has") from error
    except DECODE_ERRORS as error:
        raise UsageError(f"{path} is not a whole picture; give {what}") from error
    if kind != "PNG":
        raise UsageError(f"{path} is a {kind} file; give {what}, which loses nothing")
    if width * height > MAX_PIXELS:
        raise UsageError(f"{path} has {width}x{height} px; no camera frame has over {MAX_PIXELS // 10**6} million")
    try:
        pixels = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    except DECODE_ERRORS:
        pixels = None
    if pixels is None:
        raise UsageError(f"{path} cannot be decoded; give {what}")
    return mode, pixels


def _decode_with_pillow(path: Path) -> None:
    """Check a PNG's checksums, then its pixels: Pillow raises where OpenCV only prints."""
    with Image.open(path) as image:
        image.verify()
    with Image.open(path) as image:
        image.load()


def _kind(pixels: NDArray[Any]) -> str:
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    return f"{8 * pixels.dtype.itemsize} bits and {channels} channel{'s' if channels > 1 else ''}"
