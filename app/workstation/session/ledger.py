"""Ledger: takes that are kept or gone for good; saved without waiting, counted, and shown once."""

from __future__ import annotations

from collections.abc import Callable

from layflat.app.support.session_lines import discarded_line, kept_line
from layflat.app.workstation.session.episode import EpisodeHandle, EpisodeLost
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import COUNTED, LEVELS, SessionEvent
from layflat.app.workstation.session.take import Take
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import Outcome, StoppedBy


class Ledger:
    """Takes of one session that are over."""

    def __init__(
        self, request: SessionRequest, n_episodes: int, emit: Callable[[SessionEvent], None], clock: Callable[[], float]
    ) -> None:
        self._path, self._target, self._emit, self._clock = request.session, request.episodes, emit, clock
        self._saving: list[EpisodeHandle] = []
        self._first_start_s: float | None = None
        self.counts = dict.fromkeys(COUNTED, 0)
        """Number of takes by outcome, and of discarded ones."""
        self.n_episodes = n_episodes
        """Number of episodes in the file."""
        self.pace_s: float | None = None
        """Mean wall time for each kept take, from the first start on."""

    @property
    def saving(self) -> bool:
        """Whether a take is not durable yet."""
        return bool(self._saving)

    @property
    def enough(self) -> bool:
        """Whether as many takes as were asked for are kept, or about to be."""
        return self._target is not None and self._n_kept() + len(self._saving) >= self._target

    def note_start(self) -> None:
        """Note that a take begins."""
        if self._first_start_s is None:
            self._first_start_s = self._clock()

    def save(self, take: Take, outcome: Outcome, stopped_by: StoppedBy) -> None:
        """Begin to save a take."""
        take.handle.ask("save", outcome, stopped_by)
        self._saving.append(take.handle)

    def poll(self) -> list[SavedEpisode]:
        """Return the takes that have become durable; one whose process died meanwhile is saved from its journal."""
        found = []
        for handle in tuple(self._saving):
            try:
                handle.poll()
                saved, ended = handle.saved, handle.ended
            except EpisodeLost:
                saved, ended = handle.recover(), True
            if ended:
                self._saving.remove(handle)
                if saved is not None:
                    found.append(saved)
                    self.note_saved(saved)
        return found

    def note_saved(self, saved: SavedEpisode, *, counts: bool = True) -> None:
        """Show a durable take; ``counts``: it belongs to this session, and not to an interrupted one."""
        if counts:
            self.counts[saved.outcome] += 1
            self.n_episodes += 1
            if saved.outcome != "partial" and self._first_start_s is not None:
                self.pace_s = (self._clock() - self._first_start_s) / self._n_kept()
        self._emit(SessionEvent(kind="kept", text=kept_line(saved), level=LEVELS[saved.outcome]))

    def note_discarded(self, take: Take) -> None:
        """Show a take that is gone for good."""
        at = take.status
        if self._path is not None:
            line = discarded_line(take.seed, at.steps, at.contact, self._path)
            self._emit(SessionEvent(kind="discarded", text=line))

    def _n_kept(self) -> int:
        return self.counts["success"] + self.counts["failure"]
