"""Pictures of recorded episodes, drawn from the nodes where no images were recorded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from layflat.app.evaluation.phases import stretches
from layflat.app.media.episode_video import check_drawable
from layflat.app.media.frames import Frame, film_frame, moment, strip
from layflat.app.media.perception_overlay import Drawer
from layflat.app.support.errors import WrongCall
from layflat.data.types import Episode, Observation, Task, Truth
from layflat.sim.camera.replay_scene import Stage


class Painter:
    """Keeps one stage for each task and cloth while it is open."""

    def __init__(self) -> None:
        self._drawer = Drawer()
        self._stages: dict[tuple[Task, str], Stage] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Painter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def strip(self, episode: Episode, ticks: Sequence[int], width: int) -> tuple[Frame, ...]:
        """Frames at ``ticks`` of ``observations()``, with contact and WORD drawn; none of a cloth that is unknown."""
        if not drawable(episode):
            return ()
        seen, truths = list(episode.observations()), episode.truths()
        for tick in set(ticks):
            seen[tick] = self._pictured(episode, seen[tick], truths[tick])
        steps = tuple(
            replace(step, observation=observation) for step, observation in zip(episode.steps, seen, strict=False)
        )
        return tuple(strip(replace(episode, steps=steps, final_observation=seen[-1]), ticks, self._drawer, width))

    def film(self, episode: Episode, width: int) -> Iterator[NDArray[np.uint8]]:
        """Every observation as in ``strip``, with what goes on written on it."""
        for tick, (seen, truth) in enumerate(zip(episode.observations(), episode.truths(), strict=True)):
            yield film_frame(self._drawer(self._pictured(episode, seen, truth)), width, moment(episode, tick))

    def _pictured(self, episode: Episode, seen: Observation, truth: Truth) -> Observation:
        if seen.rgb is not None and seen.depth is not None:
            return seen
        rgb, depth = self._stage(episode).capture(truth.nodes, seen.holder_position)
        return replace(seen, rgb=rgb, depth=depth)

    def _stage(self, episode: Episode) -> Stage:
        key = episode.task, episode.cloth
        if key not in self._stages:
            self._stages[key] = self._stack.enter_context(Stage(*key))
        return self._stages[key]


def drawable(episode: Episode) -> bool:
    """Whether the recorded cloth is one that can be drawn."""
    try:
        check_drawable(episode)
    except WrongCall:
        return False
    return True


def key_ticks(episode: Episode, count: int) -> list[int]:
    """``count`` moments: the start, the end of every stretch of one phase, and the longest ones' middles.

    Where there are more stretches than room, the last ones.
    """
    ends = [0, *(part.after for part in stretches(episode))]
    while len(ends) < count:
        gaps = np.diff(ends)
        if not len(gaps) or gaps.max() < 2:
            break
        widest = int(gaps.argmax())
        ends.insert(widest + 1, ends[widest] + int(gaps[widest]) // 2)
    return ends if len(ends) <= count else [ends[0], *ends[1 - count :]]
