"""Newest value of one process for another, through shared memory: neither ever waits for the other."""

from __future__ import annotations

import json
from multiprocessing.context import BaseContext
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TRIES = 50
_HEADER = np.dtype([("begun", "i8"), ("done", "i8")])


class LatestValue:
    """Two slots of one structured dtype: one is written while the other is read.

    One writer at a time. The memory is anonymous: passed to a child process as an argument, and freed with the last
    process, however that ends.
    """

    def __init__(self, context: BaseContext, dtype: np.dtype[Any]) -> None:
        self.dtype = dtype
        self._memory: Any = context.RawArray("B", _HEADER.itemsize + 2 * dtype.itemsize)  # type: ignore[attr-defined]

    def _views(self) -> tuple[NDArray[Any], NDArray[Any]]:
        header = np.frombuffer(self._memory, dtype=_HEADER, count=1)
        return header, np.frombuffer(self._memory, dtype=self.dtype, count=2, offset=_HEADER.itemsize)

    def write(self, **fields: Any) -> None:
        """Write a new value; pass all fields, since the others are zero or as they were two values ago."""
        header, slots = self._views()
        number = int(header["done"][0]) + 1
        header["begun"][0] = number
        slot = slots[number % 2]
        for name, value in fields.items():
            slot[name] = value
        header["done"][0] = number

    def read(self, after: int = 0) -> tuple[int, np.void] | None:
        """Return the number and a copy of the newest value, or None where there is none newer than number ``after``.

        A value that was overwritten while it was copied is copied again: the writer would have to write twice in each
        of many tries to prevent that.
        """
        header, slots = self._views()
        for _ in range(_TRIES):
            number = int(header["done"][0])
            if number <= after:
                return None
            value = slots[number % 2 : number % 2 + 1].copy()[0]
            if int(header["begun"][0]) <= number + 1:
                return number, value
        return None


class LatestJson:
    """Newest JSON value of one process for another."""

    def __init__(self, context: BaseContext, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._written = b""
        self._value = LatestValue(context, np.dtype([("text", f"S{max_bytes}")]))

    def write(self, value: Any) -> None:
        """Write a value, unless it is the last one."""
        text = json.dumps(value).encode()
        if text == self._written:
            return
        if len(text) > self._max_bytes:
            raise ValueError(f"a value has {len(text)} bytes as JSON; at most {self._max_bytes} fit")
        self._value.write(text=text)
        self._written = text

    def read(self, after: int = 0) -> tuple[int, Any] | None:
        """Return number and newest value, or None where there is none newer than number ``after``."""
        found = self._value.read(after)
        return None if found is None else (found[0], json.loads(bytes(found[1]["text"])))
