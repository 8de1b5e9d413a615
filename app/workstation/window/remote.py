"""RemoteUpdates: sends a display on another machine, as by `ssh -X`, only the pixels that have changed."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Sequence

import numpy as np
import pygame
from numpy.typing import NDArray

BYTES_S = 6e6
"""Most that is sent, over some seconds; the picture comes less often instead."""
TILE_PX = 32
PIXEL_BYTES = 4


def is_remote() -> bool:
    """Return whether what is drawn goes through the network: `localhost:10` is a forwarded display."""
    return re.match(r"(?:tcp/|inet6?/)?[^/:]", os.environ.get("DISPLAY", "").removeprefix("unix")) is not None


def prepare() -> None:
    """Let SDL send a remote window part by part; by OpenGL it would send all of it. Only X servers can do that."""
    if is_remote():
        os.environ["SDL_FRAMEBUFFER_ACCELERATION"] = "0"


class RemoteUpdates:
    """Finds the tiles of areas that differ from what was sent, and says when there is room for more."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._sent_s = clock, clock()
        self._debt_bytes = 0.0
        self._shown: NDArray[np.uint32] | None = None

    def forget(self) -> None:
        """Send everything next time."""
        self._shown = None

    def has_room(self) -> bool:
        """Return whether what was sent has had its time."""
        now = self._clock()
        self._debt_bytes = max(self._debt_bytes - (now - self._sent_s) * BYTES_S, 0.0)
        self._sent_s = now
        return self._debt_bytes == 0.0

    def parts(self, surface: pygame.Surface, areas: Sequence[pygame.Rect]) -> list[pygame.Rect]:
        """Return the parts of areas to send now."""
        found, pixels = [], np.asarray(pygame.surfarray.array2d(surface), dtype=np.uint32)
        for area in areas:
            found += [area] if self._shown is None else changed_tiles(pixels, self._shown, area)
        self._debt_bytes += PIXEL_BYTES * sum(part.width * part.height for part in found)
        self._shown = pixels
        return found


def changed_tiles(now: NDArray, before: NDArray, area: pygame.Rect) -> list[pygame.Rect]:
    """Return rows of tiles of an area that cover all pixels, (width, height), which differ."""
    place = np.s_[area.left : area.right, area.top : area.bottom]
    differs = now[place] != before[place]
    for axis in (0, 1):
        differs = np.logical_or.reduceat(differs, np.arange(0, differs.shape[axis], TILE_PX), axis=axis)
    found = []
    for row, line in enumerate(differs.T):
        edges = np.flatnonzero(np.diff([False, *line.tolist(), False])) * TILE_PX
        for left, right in edges.reshape(-1, 2).tolist():
            tile = pygame.Rect(area.left + left, area.top + row * TILE_PX, right - left, TILE_PX)
            found.append(tile.clip(area))
    return found
