"""Makes a sound session of the remains of a damaged one."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import h5py

from layflat.data.atomic_files import PART_SUFFIX, WriterLock, atomic_path, write_bytes
from layflat.data.errors import DataError
from layflat.data.format import schema, superblock
from layflat.data.format.attributes import Attribute
from layflat.data.format.decode import read_demo
from layflat.data.format.encode import shared_attributes
from layflat.data.format.opening import (
    DAMAGE,
    FileBusyError,
    FileError,
    FileMarkedError,
    check_session,
    check_state,
    errors_name,
    first_line,
    open_file,
)
from layflat.data.format.structure_checks import Violation, check_demo, check_hard_link
from layflat.data.session.catalog import differences
from layflat.data.session.edit_log import intact_part, log_path
from layflat.data.session.journal_reader import read_journal
from layflat.data.session.parts import is_orphaned, journals, part_files, parts_folder
from layflat.data.session.reader import open_session
from layflat.data.session.session_writer import SessionFile, check_writable, write_errors, written_session
from layflat.data.tools.validate import validate

DAMAGED_SUFFIX = ".damaged"


@dataclass(frozen=True, kw_only=True)
class RepairReport:
    """Result of a repair."""

    target: Path
    intact: tuple[str, ...]
    """Names in ``target`` of the episodes that were intact in the session and in its parts."""
    recovered: tuple[str, ...]
    """Names of the episodes from journals of a killed recording: partial, or complete where saving was interrupted."""
    lost: tuple[Violation, ...]
    """What could not be read, and why."""
    original: Path | None
    """Copy of a damaged file that was replaced."""


def repair(path: str | Path, target: str | Path | None = None, *, force: bool = False) -> RepairReport:
    """Write every episode of a session that can be read completely into a sound session.

    Episodes come from the file (also one that lacks its last bytes), from its parts, and from the journals of a killed
    recording. Totals, masks and index are written again. A file that is only marked as open for writing, by a program
    that was killed, is kept byte for byte without the mark.

    Parameters
    ----------
    path : str or Path
        The session.
    target : str or Path, optional
        File to write. By default the session itself is replaced and its parts and journals are removed; if anything
        was lost, the old file stays as ``FILE.h5.damaged``, and a part or journal as ``FILE.h5.damaged-NAME``.
    force : bool
        Replace an existing ``target``.

    Raises
    ------
    DataError
        If nothing can be read, or ``target`` exists and ``force`` is False.
    """
    source = Path(path)
    aim = source if target is None else Path(target)
    in_place = aim.resolve() == source.resolve()
    with write_errors(aim):
        check_writable(aim, aim.resolve())
        if aim.exists() and not in_place and not force:
            raise DataError(f"{aim} exists; give another name, or force to replace it")
        with ExitStack() as locks:
            locks.enter_context(WriterLock(parts_folder(aim.resolve()), aim))
            if not in_place:
                # In a write-protected folder there is no other writer either.
                with suppress(OSError):
                    locks.enter_context(WriterLock(parts_folder(source.resolve()), source))
                if part_files(aim.resolve()):
                    raise DataError(f"{aim} has episodes that are not yet in it; choose another target")
            return _Repair(source, aim).run(in_place=in_place)


class _Repair:
    def __init__(self, source: Path, aim: Path) -> None:
        self.source = source
        self.aim = aim
        self.lost: list[Violation] = []
        self.names: dict[str, str] = {}
        """Names in the target by uid."""
        self.shared: dict[str, Attribute] = {}

    def run(self, *, in_place: bool) -> RepairReport:
        real, folder = self.source.resolve(), parts_folder(self.source.resolve())
        if not real.exists() and not part_files(real) and not journals(folder):
            raise DataError(f"{self.source} does not exist; correct the path")
        aside = parts_folder(self.aim.resolve()) / f"session.h5{PART_SUFFIX}"
        original = None
        if in_place:
            for half in folder.glob(f"*{PART_SUFFIX}"):
                half.unlink(missing_ok=True)  # Left by a killed writer: no saved episode is in it.
        with atomic_path(self.aim.resolve(), aside):
            unmarked = not part_files(real) and not journals(folder) and self._unmark(real, aside)
            recovered = () if unmarked else self._write(aside, real, folder)
            if not self.names:
                reason = f" ({self.lost[0].message})" if self.lost else ""
                raise DataError(f"{self.source} holds no episode that can be read{reason}; nothing was written")
            if in_place and self.lost and real.exists():
                original = _free(real.with_name(real.name + DAMAGED_SUFFIX))
                shutil.copy2(real, original)
        if in_place:
            self._tidy(real, folder)
        self._take_edits(in_place=in_place)
        intact = tuple(name for name in self.names.values() if name not in recovered)
        return RepairReport(
            target=self.aim, intact=intact, recovered=recovered, lost=tuple(self.lost), original=original
        )

    def _tidy(self, real: Path, folder: Path) -> None:
        """Remove parts and journals that were copied, and rename unreadable ones, which would block opening."""
        unread = {loss.path for loss in self.lost}
        for leftover in [*part_files(real), *filter(is_orphaned, journals(folder))]:
            if f"{folder.name}/{leftover.name}" in unread:
                leftover.rename(_free(real.with_name(f"{real.name}{DAMAGED_SUFFIX}-{leftover.name}")))
            else:
                leftover.unlink(missing_ok=True)

    def _take_edits(self, *, in_place: bool) -> None:
        """Keep the edits before a damaged line; the damaged log stays as another file."""
        log, aim = log_path(self.source), log_path(self.aim)
        content, error = intact_part(self.source)
        if error is not None:
            self.lost.append(Violation(path=log.name, message=str(error)))
            if in_place:
                os.replace(log, _free(log.with_name(log.name + DAMAGED_SUFFIX)))
        if content and (error is not None or not in_place):
            write_bytes(aim, content)
        elif not content:
            aim.unlink(missing_ok=True)

    def _unmark(self, real: Path, aside: Path) -> bool:
        """Copy a file without its mark; return False, with no copy, where it has none or more is wrong."""
        head = superblock.head_of(real) if real.is_file() else b""
        if not superblock.is_marked(head):
            return False
        with suppress(FileMarkedError):
            check_state(self.source)
        shutil.copyfile(real, aside)
        with aside.open("r+b") as file:
            file.write(superblock.without_mark(head))
        if validate(aside):
            aside.unlink()
            return False
        with open_session(aside, edits=False) as session:
            self.names = {info.uid: name for name, info in session.infos().items()}
        return True

    def _write(self, aside: Path, real: Path, folder: Path) -> tuple[str, ...]:
        with written_session(aside) as session:
            if real.exists():
                self._take_file(real, session, extras=True)
            for part in part_files(real):
                self._take_file(part, session, extras=False)
            recovered = [name for path in journals(folder) for name in self._take_journal(path, session)]
        return tuple(recovered)

    def _take_file(self, path: Path, session: SessionFile, *, extras: bool) -> None:
        where = "/" if extras else f"{path.parent.name}/{path.name}"
        try:
            with _opened(path, self.aim.resolve().parent) as file, errors_name(path):
                attributes = check_session(file)
                self._check_shared({key: attributes[key] for key in schema.SESSION_KEYS})
                copied = {}
                for name in _names(file):
                    new = self._take_demo(file[schema.DATA], name, session, where)
                    if new is not None:
                        copied[name] = new
                if extras:
                    self._take_extras(file, copied, session)
        except FileBusyError:
            raise
        except DataError as error:
            self.lost.append(Violation(path=where, message=str(error)))

    def _take_extras(self, file: h5py.File, copied: dict[str, str], session: SessionFile) -> None:
        try:
            session.copy_extras(file, copied)
        except DAMAGE as error:
            self.lost.append(Violation(path="/", message=f"masks or additions of users: {first_line(error)}"))

    def _take_demo(self, data: h5py.Group, name: str, session: SessionFile, where: str) -> str | None:
        try:
            check_hard_link(data, name)
            group = data[name]
            info = check_demo(group, file_bytes=max(data.file.id.get_filesize(), 1))
            read_demo(group, images=True)  # Every checksum, before the only copy is given up.
            self._check_shared(info.shared)
            if info.uid in self.names:
                return self.names[info.uid]
            new = self._free_name(name)
            session.copy(new, group, info)
        except DAMAGE as error:
            at = f"/{schema.DATA}/{name}" if where == "/" else where
            self.lost.append(Violation(path=at, message=first_line(error)))
            return None
        self.names[info.uid] = new
        return new

    def _take_journal(self, path: Path, session: SessionFile) -> Iterator[str]:
        where = f"{path.parent.name}/{path.name}"
        try:
            if not is_orphaned(path):
                raise DataError(f"{path} is still being written; end that program first")
            found = read_journal(path)
            if found is None or found.uid in self.names:
                return
            self._check_shared(shared_attributes(found.episode))
            name = self._free_name(schema.demo_name(0))
            session.add(name, found.episode, found.uid)
        except DataError as error:
            self.lost.append(Violation(path=where, message=str(error)))
            return
        self.names[found.uid] = name
        yield name

    def _check_shared(self, shared: dict[str, Attribute]) -> None:
        self.shared = self.shared or shared
        if shared != self.shared:
            raise DataError(f"belongs to another session ({differences(shared, self.shared)}); move it elsewhere")

    def _free_name(self, name: str) -> str:
        used = set(self.names.values())
        return name if name not in used else schema.demo_name(1 + max(schema.demo_number(n) for n in used))


def _names(file: h5py.File) -> list[str]:
    names = [name for name in file[schema.DATA] if schema.DEMO_NAME.fullmatch(name)]
    return sorted(names, key=schema.demo_number)


@contextmanager
def _opened(path: Path, folder: Path) -> Iterator[h5py.File]:
    """Open a file, or a copy without a writer's mark and with zeros for a missing end."""
    try:
        file = open_file(path)
    except FileBusyError:
        raise
    except FileError:
        head, there = superblock.head_of(path), path.stat().st_size
        length, marked = superblock.claimed_length(head, there), superblock.is_marked(head)
        if length is None and not marked:
            raise
        with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{path.name}.", suffix=PART_SUFFIX) as copy:
            with path.open("rb") as original:
                shutil.copyfileobj(original, copy)
            if marked:
                copy.seek(0)
                copy.write(superblock.without_mark(head))
            copy.truncate(length or there)
            copy.flush()
            with open_file(Path(copy.name)) as file:
                yield file
        return
    with file:
        yield file


def _free(path: Path) -> Path:
    number = 0
    while (candidate := path if not number else path.with_name(f"{path.name}{number}")).exists():
        number += 1
    return candidate
