"""EpisodeCollector: what a command's episodes come to; it outlives Ctrl-C, and the loss of some."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from layflat.app.support.errors import LayflatError
from layflat.app.support.metrics import episode_metrics
from layflat.app.support.progress import Progress
from layflat.app.workers.episode_pool import EpisodeFailure
from layflat.data.types import Episode


class EpisodeCollector:
    """Episodes that are done and those that are lost, each in the order in which they came."""

    def __init__(self) -> None:
        self.done: list[Episode] = []
        self.lost: list[EpisodeFailure] = []
        self._ctrl_c: KeyboardInterrupt | None = None

    @property
    def interrupted(self) -> bool:
        return self._ctrl_c is not None

    @contextmanager
    def through_ctrl_c(self) -> Iterator[None]:
        """Ctrl-C ends the body, and the command only at ``end``: what is finished is written before."""
        try:
            yield
        except KeyboardInterrupt as error:
            self._ctrl_c = error

    def gather(
        self, results: Iterable[Episode | EpisodeFailure], progress: Progress, told: Callable[[Mapping[str, Any]], str]
    ) -> None:
        """Each result as it comes, with a line that says of an episode's row what ``told`` says."""
        for result in results:
            if isinstance(result, EpisodeFailure):
                self.lost.append(result)
                progress.advance(status=f"seed {result.job.seed}: lost, {result.reason}")
            else:
                self.done.append(result)
                progress.advance(status=f"seed {result.seed}: {told(episode_metrics(result))}")

    def end(self) -> list[Episode]:
        """The episodes, where all are there; KeyboardInterrupt after Ctrl-C, LayflatError where some are lost."""
        if self._ctrl_c is not None:
            raise self._ctrl_c
        if self.lost:
            of = len(self.done) + len(self.lost)
            raise LayflatError(
                f"{len(self.lost)} of {of} episodes were lost: {self.lost[0].reason}; the others are written"
            )
        return self.done
