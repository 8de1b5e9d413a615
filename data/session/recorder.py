"""Writes sessions, so that an episode that was reported as kept survives whatever happens next.

The only copy of an episode is never inside a file that is open for writing. ``keep`` makes each a finished file of its
own in ``FILE.h5.parts``; from time to time, and on closing, ``FILE.h5`` is made anew from itself and these, written
aside and renamed, and only then are the parts removed. Readers see every kept episode in between, too
(``layflat.data.session.reader``).

A running episode has a journal there (``layflat.data.session.journal``). After a killed recording the next recorder
tidies up, and
keeps what the journals hold: whole episodes that had not been reported yet, and what there is of others as ``partial``.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import h5py

from layflat.data.atomic_files import PART_SUFFIX, WriterLock, atomic_path, fsync_path, fsync_write, os_reason
from layflat.data.errors import DataError, WriteError
from layflat.data.format import schema
from layflat.data.format.encode import LIBVER
from layflat.data.format.opening import part_files, parts_folder
from layflat.data.robot import RobotSpec
from layflat.data.session.episode_writer import EpisodeWriter
from layflat.data.session.journal import JournalHandle
from layflat.data.session.journal_reader import journal_path, journals, orphaned_journals, read_journal, remove
from layflat.data.session.reader import Session, open_session
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.session.session_writer import SessionFile, check_copy, serialize
from layflat.data.types import DESCRIPTORS, Episode, StoppedBy

PARTS_MAX = 200
"""Parts that are let lie at most: each costs a reader an open file, of which a process may have 256 on some systems."""
DYING_S = 5.0
"""How long a journal's writer may take to die when its recorder has been killed."""


class SessionRecorder:
    """The one writer of a session. Appends where the file is there and agrees in robot, cloth, step and descriptor."""

    def __init__(
        self,
        path: str | Path,
        *,
        robot: RobotSpec,
        cloth: str,
        save_images: bool = False,
        descriptor: str | None = None,
    ) -> None:
        """Finds out now whether ``path`` can be written, before time goes into episodes; DataError where not.

        Without a ``descriptor`` it is that of the session, or of the first episode.
        """
        if descriptor not in (None, *DESCRIPTORS):
            raise DataError(f"descriptor is {descriptor!r}; it must be one of {', '.join(DESCRIPTORS)}")
        self.path = Path(path)
        self.robot: RobotSpec = robot
        self.cloth = cloth
        self.descriptor = descriptor
        self.save_images = save_images
        self.recovered: tuple[SavedEpisode, ...] = ()
        """What a killed recording had left running."""
        self._next = 0
        self._uids: set[str] = set()
        self._running: list[EpisodeWriter] = []
        self._step_s: float | None = None
        self._closed = False
        with writing(self.path):
            self._real = self.path.resolve()
            self._parts = parts_folder(self._real)
            check_place(self.path, self._real)
            self._lock = WriterLock(self._parts, self.path)
        try:
            self._take_over()
        except BaseException:
            self._lock.release()
            raise

    def save(self, episode: Episode, *, journal: JournalHandle | None = None) -> SavedEpisode:
        """Returns once the episode is durable; a DataError means that it was not kept and that all others are safe.

        With the ticket of its journal, the journal has done its service then.
        """
        journal_or_new = self.new_journal() if journal is None else journal
        kept = self._keep(episode, journal_or_new.uid, journal_or_new.name, save_images=self.save_images)
        if journal is not None:
            remove(journal.path)
        return kept

    def start(self, beginning: Episode) -> EpisodeWriter:
        """Record an episode while it runs in this process.

        ``beginning`` is the episode as far as it is known: without steps, its final observation being the first.
        """
        self._check_open()
        self._check_fits(beginning)
        running = EpisodeWriter(self, self.new_journal(), beginning)
        self._running.append(running)
        return running

    def new_journal(self) -> JournalHandle:
        """For an episode that runs in another process, which writes its journal; then ``keep`` or ``recover`` it."""
        self._check_open()
        uid = uuid.uuid4().hex
        return JournalHandle(
            path=journal_path(self._parts, uid),
            uid=uid,
            save_images=self.save_images,
            name=self._next_name(),
            session=self.path,
        )

    def register(self, journal: JournalHandle, saved: SavedEpisode) -> None:
        """Take note of an episode that another process has saved with `JournalHandle.save`."""
        self._step_s, self.descriptor = saved.step_s, saved.descriptor
        self._uids.add(journal.uid)
        self._assemble_if_worth()

    def recover(self, journal: JournalHandle, *, stopped_by: StoppedBy = "crashed") -> SavedEpisode | None:
        """Keep what there is of an episode whose process ended without handing it over; None where there is nothing."""
        self._check_open()
        kept = self._recover(journal.path, stopped_by, journal.name)
        if kept is None:
            self._free_name(journal.name)
        return kept

    def discard(self, journal: JournalHandle) -> None:
        """Forget a running episode."""
        remove(journal.path)
        self._free_name(journal.name)

    def _free_name(self, name: str) -> None:
        """Use a reserved name again, if it is the last one."""
        if schema.demo_number(name) == self._next - 1:
            self._next -= 1

    def close(self) -> None:
        """Put everything into the one file. If that fails, the parts stay, and readers still find all episodes."""
        if self._closed:
            return
        for running in self._running:
            running.close()
        # Where there is no room, the journals stay as well, for repair.
        with contextlib.suppress(DataError):
            self._recover_all("interrupted")
        self._closed = True
        try:
            if part_files(self._real):
                assemble(self.path)
        finally:
            self._lock.release()

    def __enter__(self) -> SessionRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take_over(self) -> None:
        """Check what is there, and finish what a killed recorder left."""
        with writing(self.path):
            for stale in self._parts.glob(f"*{PART_SUFFIX}"):
                stale.unlink()
            fsync_path(self._real.parent)
        if part_files(self._real) or self._real.exists():
            self._take_over_session()
        self.recovered = self._recover_all("crashed")
        if part_files(self._real):
            assemble(self.path)

    def _take_over_session(self) -> None:
        with open_session(self.path) as session:
            for key in ("robot", "cloth", "descriptor"):
                there, wanted = getattr(session, key), getattr(self, key)
                if wanted is not None and there != wanted:
                    raise DataError(f"{self.path} holds episodes with {key} {there}, not {wanted}; choose another file")
            self._step_s, self.descriptor = session.step_s, session.descriptor
            self._next = 1 + max((schema.demo_number(name) for name in session.names), default=-1)
            self._uids = {info.uid for info in session.infos().values()}

    def _recover_all(self, stopped_by: StoppedBy) -> tuple[SavedEpisode, ...]:
        kept = [self._recover(path, stopped_by) for path in journals(self._parts) if self._left_alone(path)]
        return tuple(episode for episode in kept if episode is not None)

    def _left_alone(self, journal: Path) -> bool:
        """A killed recording's processes die with it, but not in the same instant."""
        give_up = time.monotonic() + DYING_S
        while not orphaned_journals(journal):
            if time.monotonic() > give_up:
                return False
            time.sleep(0.01)
        return journal.exists()

    def _recover(self, journal: Path, stopped_by: StoppedBy, name: str = "") -> SavedEpisode | None:
        if not journal.exists():
            return None
        found = read_journal(journal, stopped_by=stopped_by)
        kept = None
        if found is not None and found.uid not in self._uids:
            # The journal holds images only where they were asked for.
            kept = self._keep(found.episode, found.uid, name or self._next_name(), save_images=True)
        remove(journal)
        return kept

    def _next_name(self) -> str:
        self._next += 1
        return schema.demo_name(self._next - 1)

    def _keep(self, episode: Episode, uid: str, name: str, *, save_images: bool) -> SavedEpisode:
        self._check_open()
        self._check_fits(episode)
        image = serialize(name, episode, uid, save_images=save_images)
        with writing(self.path):
            fsync_write(self._parts / f"{name}.h5", image)
        self._uids.add(uid)
        self._step_s, self.descriptor = episode.step_s, episode.descriptor
        self._assemble_if_worth()
        return SavedEpisode(
            name=name,
            path=self.path,
            n_steps=len(episode.steps),
            size_bytes=len(image),
            outcome=episode.outcome,
            contact_final=episode.final_observation.contact_portion,
            step_s=episode.step_s,
            descriptor=episode.descriptor,
        )

    def _assemble_if_worth(self) -> None:
        # The episodes are safe already; should there be no room to assemble, their parts stay until there is.
        with contextlib.suppress(DataError, OSError):
            if self._worth_assembling():
                assemble(self.path)

    def _check_open(self) -> None:
        if self._closed:
            raise DataError(f"{self.path} is closed; open a new recorder")

    def _check_fits(self, episode: Episode) -> None:
        for key, wanted, got in (
            ("robot", self.robot, episode.robot),
            ("cloth", self.cloth, episode.cloth),
            ("descriptor", self.descriptor, episode.descriptor),
            ("step_s", self._step_s, episode.step_s),
        ):
            if wanted is not None and got != wanted:
                raise DataError(f"the episode's {key} is {got}; all episodes of {self.path} have {wanted}")
        if not episode.step_s > 0:
            raise DataError(f"the episode's step_s is {episode.step_s}; it must be above 0")

    def _worth_assembling(self) -> bool:
        """When the parts weigh as much as the file: so that all copying together stays in proportion to the data."""
        parts = part_files(self._real)
        assembled = self._real.stat().st_size if self._real.exists() else 0
        return len(parts) >= PARTS_MAX or sum(part.stat().st_size for part in parts) >= assembled


def assemble(path: Path) -> None:
    """Move all parts into the session's file; the caller holds the writer's lock."""
    with writing(path):
        real = path.resolve()
        # Listed before they are read: a part that another process finishes meanwhile stays for the next time.
        parts = part_files(real)
        aside = parts_folder(real) / f"session.h5{PART_SUFFIX}"
        with atomic_path(real, aside), open_session(path) as session:
            _add_parts(session, real, aside)
            digests = {name: line.digest for name, line in session.lines().items()}
            added = {name: digests[name] for name in session.names if name not in session.main_names}
            check_copy(aside, added, session.names)
        for part in parts:
            part.unlink()


def _add_parts(session: Session, real: Path, aside: Path) -> None:
    main, there = session.main_file, set(session.main_names)
    current = main is not None and main[schema.DATA].attrs[schema.VERSION] == schema.SCHEMA_VERSION
    if current:
        # A copy of the bytes, and then only what is new: what users have added stays as it is.
        shutil.copyfile(real, aside)
    with h5py.File(aside, "r+" if current else "x", libver=LIBVER) as file:
        lines = session.lines()
        target = SessionFile(file, {n: lines[n] for n in there} if current else None, indexed=session.indexed)
        for name in session.names:
            if name not in there or not current:
                target.copy(name, session.group(name), session.info(name))
        if main is not None and not current:
            target.copy_extras(main, {name: name for name in there})
        target.finish()


def check_place(path: Path, real: Path) -> None:
    """What mkdir would not say in plain words, or not to root."""
    if not real.parent.is_dir():
        problem = "is not a folder" if real.parent.exists() else "does not exist"
        raise DataError(f"{path} cannot be written: {real.parent} {problem}")
    if real.is_dir():
        raise DataError(f"{path} is a folder; name a file in it, such as {path / 'session.h5'}")
    if real.exists() and not real.is_file():
        raise DataError(f"{path} is not a regular file; choose another one")
    if real.exists() and not os.access(real, os.W_OK):
        raise DataError(f"{path} is write-protected; choose another file or allow writing")


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Errors of the file system as one sentence."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # RuntimeError: HDF5, closing a file that it could not write in full.
        raise WriteError(
            f"{path} cannot be written: {os_reason(error)}; episodes that were kept before are safe"
        ) from error
