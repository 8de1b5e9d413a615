"""RGB-D frames from two files: colour (PNG or JPEG, 8 bits) and depth (PNG or TIFF, one channel); masks."""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from dataclasses import dataclass
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
NO_VALUE = 65535
DEPTH_UNITS_MM = {np.dtype(np.uint16): 1.0, np.dtype(np.float32): 1000.0}
"""Millimetres of one unit where nothing else is said, by the kind of number."""
OPENNI_SIZES, OPENNI_ROWS = ((1024, 1280), (480, 640)), (32, 992)
"""Sizes of colour and registered depth of OpenNI's cameras in SXGA, and the colour's rows that the depth covers."""
MAX_ASPECT_ERROR = 0.01
DECODE_ERRORS = (OSError, SyntaxError, ValueError, LookupError, struct.error, zlib.error, cv2.error)


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Read a PNG or JPEG as (H, W, 3) uint8 RGB, a grey one as well; transparency is dropped. UsageError otherwise."""
    _, pixels = _read(path, "a colour picture as PNG or JPEG", ("PNG", "JPEG"))
    if pixels.dtype != np.uint8:
        raise UsageError(f"{path} has {_kind(pixels)}; a picture with 8 bits is needed: is it the depth?")
    if pixels.ndim == 2 or pixels.shape[2] == 2:
        grey = pixels if pixels.ndim == 2 else pixels[..., 0]
        return np.ascontiguousarray(np.repeat(grey[..., None], 3, axis=2))
    return np.ascontiguousarray(pixels[..., 2::-1])  # OpenCV's order is blue, green, red


def read_depth(path: Path, scale_mm: float | None = None) -> tuple[NDArray[np.float32], float]:
    """Read depth as (H, W) float32 m, and return the millimetres of one unit of the file. UsageError otherwise.

    The unit is ``scale_mm``, else 1 mm for 16 bits and 1 m for floats. A missing value is 0; in the file it is 0,
    NO_VALUE, negative or not finite.
    """
    if scale_mm is not None and not (math.isfinite(scale_mm) and 0 < scale_mm <= 1000):
        raise UsageError(f"--depth-scale is {scale_mm:g}; it must be the millimetres of one unit, such as 1 or 0.25")
    mode, pixels = _read(path, "a depth image as PNG with 16 bits or TIFF with floats", ("PNG", "TIFF"))
    if pixels.ndim != 2 or mode == "LA":
        raise UsageError(
            f"{path} has {_kind(pixels)}; depth has one channel: save the sensor's values, not a picture of them"
        )
    if pixels.dtype not in DEPTH_UNITS_MM:
        raise UsageError(
            f"{path} has {_kind(pixels)}; depth needs 16 bits, whole millimetres: 8 bits lose the millimetres"
        )
    unit_mm = scale_mm or DEPTH_UNITS_MM[pixels.dtype]
    valid = np.where(np.isfinite(pixels) & (pixels > 0) & (pixels != NO_VALUE), pixels, 0)
    if not valid.any():
        raise UsageError(f"{path} is 0 or {NO_VALUE} everywhere: it holds no depth at all")
    return np.asarray(valid * np.float32(unit_mm / 1000), dtype=np.float32), unit_mm


def read_mask(path: Path) -> NDArray[np.bool_]:
    """Read a PNG whose pixels are not black where the cloth is, as (H, W) bool."""
    mode, pixels = _read(path, "a mask as PNG")
    if pixels.ndim == 3:  # transparency says nothing
        pixels = pixels[..., : 1 if mode == "LA" else 3].max(axis=2)
    mask = np.asarray(pixels > 0)
    if not mask.any() or mask.all():
        raise UsageError(
            f"{path} is {'not black' if mask.any() else 'black'} everywhere; it must show where the cloth is"
        )
    return mask


@dataclass(frozen=True, kw_only=True)
class SizeMatch:
    """How a colour picture is brought to the size of its depth, or the depth to the picture's."""

    size: tuple[int, int]
    """(H, W) of both afterwards."""
    rows: tuple[int, int] | None = None
    """First and last row (excluded) of the colour picture that the depth sees; all of them by default."""
    note: str = ""
    """One sentence on the action, for a person."""

    def color(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Return a colour picture at the common size."""
        return self._resize(self._seen(pixels), cv2.INTER_AREA)

    def mask(self, pixels: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return a mask, of the colour picture or already of the common size, at the common size."""
        whole = pixels if pixels.shape == self.size else self._seen(pixels)
        return np.asarray(self._resize(whole.astype(np.uint8), cv2.INTER_NEAREST) > 0)

    def depth(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return depth at the common size; never averaged, since that invents depth at edges."""
        return np.asarray(self._resize(values, cv2.INTER_NEAREST), np.float32)

    def point(self, at: tuple[int, int], height: int) -> tuple[int, int]:
        """Return where a pixel (column, row) of the colour picture, ``height`` px high, is afterwards."""
        top, bottom = self.rows or (0, height)
        scale = self.size[0] / (bottom - top)
        return math.floor(at[0] * scale), math.floor((at[1] - top) * scale)

    def _seen(self, pixels: NDArray[Any]) -> NDArray[Any]:
        return pixels if self.rows is None else pixels[slice(*self.rows)]

    def _resize(self, pixels: NDArray[Any], interpolation: int) -> NDArray[Any]:
        return (
            pixels
            if pixels.shape[:2] == self.size
            else cv2.resize(pixels, self.size[::-1], interpolation=interpolation)
        )


def match_sizes(rgb_path: Path, rgb: NDArray[Any], depth_path: Path, depth: NDArray[Any]) -> SizeMatch:
    """Return how colour and depth come to one size. UsageError where they cannot have the same field of view."""
    color, size = rgb.shape[:2], depth.shape
    if color == size:
        return SizeMatch(size=size)
    names = f"{color[1]}x{color[0]} px and depth of {size[1]}x{size[0]} px"
    if (color, size) == OPENNI_SIZES:
        rows = f"rows {OPENNI_ROWS[0]} to {OPENNI_ROWS[1] - 1} of the colour were halved, as OpenNI registers them"
        note = f"colour of {names}: {rows}; --intrinsics are those of {size[1]}x{size[0]} px"
        return SizeMatch(size=size, rows=OPENNI_ROWS, note=note)
    if abs(color[1] * size[0] / (color[0] * size[1]) - 1) > MAX_ASPECT_ERROR:
        raise UsageError(
            f"{rgb_path} is {color[1]}x{color[0]} px and {depth_path} {size[1]}x{size[0]} px, of another shape; "
            "save depth that is aligned to the colour picture"
        )
    smaller = min(color, size)
    note = f"colour of {names}: taken for the same field of view, at {smaller[1]}x{smaller[0]} px (so are --intrinsics)"
    return SizeMatch(size=(smaller[0], smaller[1]), note=note)


def _read(path: Path, what: str, kinds: tuple[str, ...] = ("PNG",)) -> tuple[str, NDArray[Any]]:
    """Return Pillow's mode and OpenCV's pixels of a picture, unchanged, after a check of its header and checksums."""
    validators.readable_file(path, what)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about the size, which is checked here
            with Image.open(path) as image:
                kind, mode, (width, height) = image.format, image.mode, image.size
            if kind in kinds and width * height <= MAX_PIXELS:
                _decode_with_pillow(path)
    except Image.DecompressionBombError as error:
        raise UsageError(f"{path} has more than {MAX_PIXELS // 10**6} million pixels; no camera frame has") from error
    except DECODE_ERRORS as error:
        raise UsageError(f"{path} is not a whole picture; give {what}") from error
    if kind not in kinds:
        raise UsageError(f"{path} is a {kind} file; give {what}")
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
    """Check a picture's checksums, then its pixels: Pillow raises where OpenCV only prints."""
    with Image.open(path) as image:
        image.verify()
    with Image.open(path) as image:
        image.load()


def _kind(pixels: NDArray[Any]) -> str:
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    return f"{8 * pixels.dtype.itemsize} bits and {channels} channel{'s' if channels > 1 else ''}"
