"""A camera's frame from two PNG files: colour with 8 bits, depth with 16 bits and one channel."""

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

MOST_PIXELS = 50_000_000
"""A D435's largest picture has 2 million; decoding more than this is not what was meant."""
NOT_DECODED = (OSError, SyntaxError, ValueError, LookupError, struct.error, zlib.error, cv2.error)


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of a colour PNG; transparency is dropped. UsageError for anything else."""
    mode, pixels = _read(path, "a colour picture as PNG")
    if mode in ("1", "L", "LA") or pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
        raise UsageError(
            f"{path} is grey ({_kind(pixels)}); a colour picture with 3 channels is needed: is it the depth?"
        )
    if pixels.dtype != np.uint8:
        raise UsageError(f"{path} has {_kind(pixels)}; a colour picture with 8 bits is needed")
    return np.ascontiguousarray(pixels[..., 2::-1])  # OpenCV's order is blue, green, red


def read_depth(path: Path, scale_mm: float = 1.0) -> NDArray[np.float32]:
    """(H, W) float32 m of a 16-bit PNG in units of ``scale_mm``, 0 where missing. UsageError for anything else."""
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


def same_size(rgb_path: Path, rgb: NDArray[Any], depth_path: Path, depth: NDArray[Any]) -> None:
    """UsageError unless both show the same pixels."""
    if rgb.shape[:2] != depth.shape:
        raise UsageError(
            f"{rgb_path} is {rgb.shape[1]}x{rgb.shape[0]} px and {depth_path} {depth.shape[1]}x{depth.shape[0]} px; "
            "save depth that is aligned to the colour picture"
        )


def _read(path: Path, what: str) -> tuple[str, NDArray[Any]]:
    """Pillow's mode and OpenCV's pixels of a PNG, unchanged, after a look at its header and its checksums."""
    validators.readable_file(path, what)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about its size, which is looked at here
            with Image.open(path) as picture:
                kind, mode, size = picture.format, picture.mode, picture.size
            if kind == "PNG" and size[0] * size[1] <= MOST_PIXELS:
                _try_out(path)
    except Image.DecompressionBombError as error:
        raise UsageError(
            f"{path} has more than {MOST_PIXELS // 10**6} million pixels; that is no camera's frame"
        ) from error
    except NOT_DECODED as error:
        raise UsageError(f"{path} is not a whole picture; give {what}") from error
    if kind != "PNG":
        raise UsageError(f"{path} is a {kind} file; give {what}, which loses nothing")
    if size[0] * size[1] > MOST_PIXELS:
        raise UsageError(
            f"{path} has {size[0]}x{size[1]} px; more than {MOST_PIXELS // 10**6} million are no camera's frame"
        )
    try:
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    except NOT_DECODED as error:
        raise UsageError(f"{path} cannot be decoded; give {what}") from error
    if pixels is None:
        raise UsageError(f"{path} cannot be decoded; give {what}")
    return mode, pixels


def _try_out(path: Path) -> None:
    """Decode a PNG with Pillow, which raises where OpenCV prints: its checksums first, then its pixels."""
    with Image.open(path) as picture:
        picture.verify()
    with Image.open(path) as picture:
        picture.load()


def _kind(pixels: NDArray[Any]) -> str:
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    return f"{8 * pixels.dtype.itemsize} bits and {channels} channel{'s' if channels > 1 else ''}"
