"""Checked, read-only numpy arrays."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from layflat.data.errors import DataError

FloatArray: TypeAlias = NDArray[np.float64]


def frozen_array(value: ArrayLike, shape: tuple[int | None, ...], name: str, dtype: DTypeLike = np.float64) -> NDArray:
    """Return a read-only copy of ``value`` with the given shape (None: any length), or raise a DataError naming it."""
    array = np.array(value, dtype=dtype)
    if array.ndim != len(shape) or any(w is not None and w != g for w, g in zip(shape, array.shape, strict=True)):
        raise DataError(f"{name} has shape {array.shape}; it must be {shape}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise DataError(f"{name} holds a value that is not finite")
    array.setflags(write=False)
    return array
