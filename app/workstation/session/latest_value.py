"""Newest value of one process for another, through shared memory: neither ever waits for the other."""

from __future__ import annotations

from multiprocessing.context import BaseContext
from multiprocessing.reduction import ForkingPickler
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
_TRIES = 50
_HEADER = np.dtype([("begun", "i8"), ("done", "i8"), ("sizes", "i8", 2)])


class LatestValue(Generic[T]):
    """Two slots for a value: one is written while the other is read.

    One writer at a time. The memory is anonymous: passed to a child process as an argument, and freed with the last
    process, however that ends. Values are pickled, as in any pipe between a process and its children.
    """

    def __init__(self, context: BaseContext, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._memory: Any = context.RawArray("B", _HEADER.itemsize + 2 * max_bytes)  # type: ignore[attr-defined]

    def _views(self) -> tuple[NDArray[Any], memoryview]:
        memory = memoryview(self._memory).cast("B")
        return np.frombuffer(memory, dtype=_HEADER, count=1), memory[_HEADER.itemsize :]

    def write(self, value: T) -> None:
        """Replace the value."""
        content = ForkingPickler.dumps(value)
        if len(content) > self._max_bytes:
            raise ValueError(f"a value has {len(content)} bytes; at most {self._max_bytes} fit")
        header, slots = self._views()
        number = int(header["done"][0]) + 1
        header["begun"][0] = number
        at = number % 2 * self._max_bytes
        slots[at : at + len(content)] = content
        header["sizes"][0, number % 2] = len(content)
        header["done"][0] = number

    def read(self, after: int = 0) -> tuple[int, T] | None:
        """Return number and newest value, or None where there is none newer than number ``after``.

        A value that was overwritten while it was copied is copied again: the writer would have to write twice in each
        of many tries to prevent that.
        """
        header, slots = self._views()
        for _ in range(_TRIES):
            number = int(header["done"][0])
            if number <= after:
                return None
            at = number % 2 * self._max_bytes
            content = bytes(slots[at : at + int(header["sizes"][0, number % 2])])
            if int(header["begun"][0]) <= number + 1:
                return number, ForkingPickler.loads(content)
        return None
