"""Pictures of recorded episodes, drawn from the nodes where no images were recorded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from layflat.app.evaluation.phases import phase_spans
from layflat.app.media.episode_video import check_drawable
from layflat.app.media.frames import Frame, frame_label, frame_strip, video_frame
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.support.errors import UsageError
from layflat.data.types import Episode, GroundTruth, Observation
from layflat.sim.camera.replay_scene import ReplayScene


class EpisodeRenderer:
    """Keeps one stage for each robot and cloth while it is open."""

    def __init__(self) -> None:
        self._drawer = PerceptionOverlay()
        self._stages: dict[tuple[str, str], ReplayScene] = {}
        self._stack = ExitStack()

    def __enter__(self) -> EpisodeRenderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def frame_strip(self, episode: Episode, step_indices: Sequence[int], width: int) -> tuple[Frame, ...]:
        """Frames at ``steps`` of ``observations()``, with contact and WORD drawn; none of a cloth that is unknown."""
        if not drawable(episode):
            return ()
        seen, ground_truths = list(episode.observations()), episode.ground_truths()
        for step_index in set(step_indices):
            seen[step_index] = self._pictured(episode, seen[step_index], ground_truths[step_index])
        steps = tuple(
            replace(step, observation=observation) for step, observation in zip(episode.steps, seen, strict=False)
        )
        return tuple(
            frame_strip(replace(episode, steps=steps, final_observation=seen[-1]), step_indices, self._drawer, width)
        )

    def film(self, episode: Episode, width: int) -> Iterator[NDArray[np.uint8]]:
        """Every observation as in ``strip``, with what goes on written on it."""
        for step_index, (seen, ground_truth) in enumerate(
            zip(episode.observations(), episode.ground_truths(), strict=True)
        ):
            yield video_frame(
                self._drawer(self._pictured(episode, seen, ground_truth)), width, frame_label(episode, step_index)
            )

    def _pictured(self, episode: Episode, seen: Observation, ground_truth: GroundTruth) -> Observation:
        if seen.rgb is not None and seen.depth is not None:
            return seen
        rgb, depth = self._stage(episode).capture(ground_truth.nodes, seen.holder_position)
        return replace(seen, rgb=rgb, depth=depth)

    def _stage(self, episode: Episode) -> ReplayScene:
        key = episode.robot.name, episode.cloth
        if key not in self._stages:
            self._stages[key] = self._stack.enter_context(ReplayScene(*key))
        return self._stages[key]


def drawable(episode: Episode) -> bool:
    """Whether the recorded cloth is one that can be drawn."""
    try:
        check_drawable(episode)
    except UsageError:
        return False
    return True


def key_steps(episode: Episode, count: int) -> list[int]:
    """``count`` moments: the start, the end of every stretch of one phase, and the longest ones' middles.

    Where there are more stretches than room, the last ones.
    """
    ends = [0, *(part.after for part in phase_spans(episode))]
    while len(ends) < count:
        gaps = np.diff(ends)
        if not len(gaps) or gaps.max() < 2:
            break
        widest = int(gaps.argmax())
        ends.insert(widest + 1, ends[widest] + int(gaps[widest]) // 2)
    return ends if len(ends) <= count else [ends[0], *ends[1 - count :]]
