"""An episode that is being recorded in this process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from layflat.data.session.journal import JournalHandle
from layflat.data.types import DisturbanceRecord, Episode, Step

if TYPE_CHECKING:
    from layflat.data.session.recorder import SessionRecorder
    from layflat.data.session.saved_episode import SavedEpisode


class EpisodeWriter:
    """A hook of the loop; the episode is kept or discarded at its end.

    If neither happens, because the program is killed or the recorder closed, what there is of it is kept as partial.
    """

    def __init__(self, recorder: SessionRecorder, ticket: JournalHandle, beginning: Episode) -> None:
        self._recorder = recorder
        self._ticket = ticket
        self._writer = ticket.open(beginning)

    def step(self, step: Step) -> None:
        """One step that is over; DataError where the disk does not take it."""
        self._writer.step(step)

    def on_step(self, step: Step, step_index: int) -> None:
        """As a hook of the loop."""
        self._writer.step(step)

    def on_disturbance(self, records: Sequence[DisturbanceRecord]) -> None:
        """What has befallen the cloth so far."""
        self._writer.on_disturbance(records)

    def save(self, episode: Episode) -> SavedEpisode:
        """The whole episode, durable on return, as SessionRecorder.keep; its outcome is the caller's to say.

        Where a DataError says that it could not be kept, its journal stays, for the recorder or repair to try again.
        """
        self._writer.finish(episode)
        return self._recorder.save(episode, journal=self._ticket)

    def discard(self) -> None:
        """Nobody wants it."""
        self._writer.close()
        self._recorder.discard(self._ticket)

    def close(self) -> None:
        """Stop writing; the recorder keeps what there is when it closes."""
        self._writer.close()
