"""Writes sessions, so that an episode that was reported as saved survives any crash or power cut.

The only copy of an episode is never inside a file that is open for writing. `SessionRecorder.save` writes each episode
to a file of its own in ``FILE.h5.parts``; from time to time, and on closing, ``FILE.h5`` is written again from itself
and these, aside and renamed, and only then are the parts removed. Readers see every saved episode in between, too
(`layflat.data.session.reader`).

A running episode has a journal there (`layflat.data.session.journal`). After a killed recording the next recorder saves
the episodes of the journals: complete ones that had not been reported yet, and the others as ``partial``.
"""

from __future__ import annotations

import contextlib
import logging
import time
import uuid
from dataclasses import replace
from pathlib import Path
from types import TracebackType

from layflat.data.atomic_files import PART_SUFFIX, WriterLock, fsync_folder
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute
from layflat.data.format.encode import shared_attributes
from layflat.data.format.opening import FileBusyError
from layflat.data.robot import RobotSpec
from layflat.data.session.assembly import assemble, is_worthwhile
from layflat.data.session.edit_log import log_path
from layflat.data.session.journal import JournalHandle
from layflat.data.session.journal_reader import read_journal
from layflat.data.session.parts import is_orphaned, journal_path, journals, part_files, parts_folder
from layflat.data.session.reader import open_session
from layflat.data.session.saved_episode import SavedEpisode, save_part, saved_in
from layflat.data.session.session_writer import check_writable, write_errors
from layflat.data.types import DESCRIPTORS, Episode, StoppedBy

_LOG = logging.getLogger("layflat")
DYING_S = 5.0
"""Time that a journal's writer may take to die when its recorder has been killed."""


class SessionRecorder:
    """The one writer of a session.

    It appends to a file that exists and agrees in robot, task, physics, cloth, step and descriptor.

    Parameters
    ----------
    path : str or Path
        The session's file.
    robot : RobotSpec
        Robot of all episodes.
    cloth : str
        Name of the cloth of all episodes.
    save_images : bool
        Save rgb and depth of the observations.
    descriptor, task, physics : str or None
        Names that all episodes share; None takes those of the session or of the first episode.

    Raises
    ------
    DataError
        If ``path`` cannot be written or holds episodes of others; found out now, before time goes into episodes.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        robot: RobotSpec,
        cloth: str,
        save_images: bool = False,
        descriptor: str | None = None,
        task: str | None = None,
        physics: str | None = None,
    ) -> None:
        if not isinstance(robot, RobotSpec):
            raise DataError(f"robot is {robot!r}; it must be a RobotSpec")
        if descriptor not in (None, *DESCRIPTORS):
            raise DataError(f"descriptor is {descriptor!r}; it must be one of {', '.join(DESCRIPTORS)}")
        self.path = Path(path)
        self.robot = robot
        self.save_images = save_images
        self.recovered: tuple[SavedEpisode, ...] = ()
        """Episodes that a killed recording had left running."""
        self._shared: dict[str, Attribute] = {
            schema.ROBOT: robot.name,
            schema.ACTION_AXES: robot.axes_json(),
            schema.CLOTH: cloth,
        }
        optional = {schema.DESCRIPTOR: descriptor, schema.TASK: task, schema.PHYSICS: physics}
        self._shared |= {key: value for key, value in optional.items() if value is not None}
        self._next = 0
        self._free: list[int] = []
        self._uids: set[str] = set()
        self._contents: dict[str, str] = {}
        """Name of the first episode with each content."""
        self._running: list[EpisodeWriter] = []
        self._closed = False
        with write_errors(self.path):
            self._real = self.path.resolve()
            self._parts = parts_folder(self._real)
            check_writable(self.path, self._real)
            self._lock = WriterLock(self._parts, self.path)
        try:
            self._take_over()
        except BaseException:
            self._lock.release()
            raise

    def save(self, episode: Episode, *, journal: JournalHandle | None = None) -> SavedEpisode:
        """Save an episode and return when it is durable.

        Parameters
        ----------
        episode : Episode
            The finished episode.
        journal : JournalHandle or None
            Journal of the episode, which is removed afterwards.

        Raises
        ------
        DataError
            If the episode was not saved; all others are safe.
        """
        handle = journal or self.new_journal()
        try:
            saved = self._save(episode, handle.uid, handle.name, save_images=self.save_images)
        except BaseException:
            if journal is None:
                self._free_name(handle.name)
            raise
        handle.path.unlink(missing_ok=True)
        return saved

    def start(self, initial: Episode) -> EpisodeWriter:
        """Record an episode while it runs in this process.

        ``initial`` is the episode as far as it is known: without steps, its final observation being the first.
        """
        self._check_open()
        self._check_fits(initial)
        running = EpisodeWriter(self, self.new_journal(), initial)
        self._running.append(running)
        return running

    def new_journal(self) -> JournalHandle:
        """Return a journal for an episode that runs in another process; then `save` or `recover` the episode."""
        self._check_open()
        uid = uuid.uuid4().hex
        return JournalHandle(
            path=journal_path(self._parts, uid),
            uid=uid,
            save_images=self.save_images,
            name=self._reserve_name(),
            session=self.path,
        )

    def register(self, saved: SavedEpisode) -> SavedEpisode:
        """Note an episode that another process has saved with `JournalHandle.save`; return it with its ``copy_of``."""
        self._uids.add(saved.uid)
        first = self._contents.setdefault(saved.content, saved.name)
        self._shared = dict(saved.shared)
        # The episodes are safe already; without room to assemble, their parts stay until there is.
        with contextlib.suppress(DataError, OSError):
            if is_worthwhile(self._real):
                assemble(self.path)
        return replace(saved, copy_of=None if first == saved.name else first)

    def recover(self, journal: JournalHandle, *, stopped_by: StoppedBy = "crashed") -> SavedEpisode | None:
        """Save the journal's episode, whose process ended without handing it over; return None where there is none."""
        self._check_open()
        part = self._parts / f"{journal.name}.h5"
        if part.exists():  # The process ended between saving the episode and reporting it.
            complete = saved_in(part, journal.name, self.path)
            journal.path.unlink(missing_ok=True)
            return self.register(complete)
        saved = self._recover(journal.path, stopped_by, journal.name)
        if saved is None:
            self._free_name(journal.name)
        return saved

    def discard(self, journal: JournalHandle) -> None:
        """Forget a running episode, also where its process has saved it but not reported it."""
        journal.path.unlink(missing_ok=True)
        (self._parts / f"{journal.name}.h5").unlink(missing_ok=True)
        self._free_name(journal.name)

    def close(self) -> None:
        """Move everything into the one file. If that fails, the parts stay, and readers still find all episodes."""
        if self._closed:
            return
        for running in self._running:
            running.close()
        # Without room on the disk the journals stay as well, for repair.
        with contextlib.suppress(DataError):
            self._recover_all("interrupted")
        self._closed = True
        try:
            if part_files(self._real):
                assemble(self.path)
        except FileBusyError as error:
            # Nothing is lost or missing: readers see the parts, too, and the next recorder or a repair moves them.
            _LOG.warning("layflat: %s; the new episodes are safe in %s, and part of the session", error, self._parts)
        finally:
            self._lock.release()

    def __enter__(self) -> SessionRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take_over(self) -> None:
        """Check an existing session, and finish what a killed recorder left."""
        with write_errors(self.path):
            for stale in self._parts.glob(f"*{PART_SUFFIX}"):
                stale.unlink()
            fsync_folder(self._real.parent)
        log = log_path(self._real)
        if not self._real.exists() and not part_files(self._real) and log.exists():
            raise DataError(f"{self.path} is new, but {log.name} edits an earlier session of that name; move it away")
        if part_files(self._real) or self._real.exists():
            with open_session(self.path, edits=False) as session:
                for key, value in session.shared.items():
                    if self._shared.get(key, value) != value:
                        wanted = self._shared[key]
                        raise DataError(f"{self.path} has {key} {value}, not {wanted}; choose another file")
                self._shared = session.shared
                self._next = 1 + max((schema.demo_number(name) for name in session.names), default=-1)
                self._uids = {info.uid for info in session.infos().values()}
                for name, content in session.contents().items():
                    self._contents.setdefault(content, name)
        self.recovered = self._recover_all("crashed")
        if part_files(self._real):
            assemble(self.path)

    def _recover_all(self, stopped_by: StoppedBy) -> tuple[SavedEpisode, ...]:
        saved = [self._recover(path, stopped_by) for path in journals(self._parts) if self._left_alone(path)]
        return tuple(episode for episode in saved if episode is not None)

    def _left_alone(self, journal: Path) -> bool:
        """Wait for the writer of a journal to die; a killed recording's processes die with it, but not instantly."""
        give_up = time.monotonic() + DYING_S
        while not is_orphaned(journal):
            if time.monotonic() > give_up:
                return False
            time.sleep(0.01)
        return journal.exists()

    def _recover(self, journal: Path, stopped_by: StoppedBy, name: str | None = None) -> SavedEpisode | None:
        if not journal.exists():
            return None
        found = read_journal(journal, stopped_by=stopped_by)
        saved = None
        if found is not None and found.uid not in self._uids:
            # The journal holds images only where they were asked for.
            saved = self._save(found.episode, found.uid, name or self._reserve_name(), save_images=True)
        journal.unlink(missing_ok=True)
        return saved

    def _save(self, episode: Episode, uid: str, name: str, *, save_images: bool) -> SavedEpisode:
        self._check_open()
        self._check_fits(episode)
        saved = save_part(self.path, self._parts, name, episode, uid, save_images=save_images)
        return self.register(saved)

    def _reserve_name(self) -> str:
        """Return the lowest name that no episode has, or had when this recorder was opened."""
        if self._free:
            return schema.demo_name(self._free.pop(self._free.index(min(self._free))))
        self._next += 1
        return schema.demo_name(self._next - 1)

    def _free_name(self, name: str) -> None:
        """Use a reserved name again."""
        self._free.append(schema.demo_number(name))

    def _check_open(self) -> None:
        if self._closed:
            raise DataError(f"{self.path} is closed; open a new recorder")

    def _check_fits(self, episode: Episode) -> None:
        for key, value in shared_attributes(episode).items():
            if self._shared.get(key, value) != value:
                raise DataError(f"the episode's {key} is {value}; all episodes of {self.path} have {self._shared[key]}")
        if not episode.step_s > 0:
            raise DataError(f"the episode's step_s is {episode.step_s}; it must be above 0")


class EpisodeWriter:
    """An episode that is being recorded in this process; its ``on_...`` methods are callbacks of the rollout.

    If it is neither saved nor discarded, because the program is killed or the recorder closed, its steps so far are
    saved as a partial episode.
    """

    def __init__(self, recorder: SessionRecorder, handle: JournalHandle, initial: Episode) -> None:
        self._recorder = recorder
        self._handle = handle
        self._journal = handle.open(initial)
        self.step = self._journal.step
        self.on_step = self._journal.on_step
        self.on_disturbance = self._journal.on_disturbance
        self.close = self._journal.close

    def save(self, episode: Episode) -> SavedEpisode:
        """Save the finished episode as `SessionRecorder.save` does; after a DataError its journal stays for repair."""
        self._journal.finish(episode)
        return self._recorder.save(episode, journal=self._handle)

    def discard(self) -> None:
        """Forget the episode."""
        self._journal.close()
        self._recorder.discard(self._handle)
