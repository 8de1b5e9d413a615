"""Finds everything that is wrong with a session; never crashes, hangs or raises on any bytes."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path

import h5py

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, texts_violations
from layflat.data.format.content import content_of_group
from layflat.data.format.decode import read_demo
from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.masks import OWN_MASKS, masks_of, read_masks
from layflat.data.format.opening import DAMAGE, check_session, check_state, errors_name, first_line, open_file
from layflat.data.format.structure_checks import Violation, Violations, check_hard_link, inspect_demo, inspect_links
from layflat.data.format.value_checks import inspect_contents
from layflat.data.sandbox import CallError, call_in_sandbox
from layflat.data.session.edit_log import log_path, read_log
from layflat.data.session.index import read_index
from layflat.data.session.parts import is_orphaned, journals, part_files, parts_folder

MIN_LIMIT_S = 60.0
BYTES_PER_S = 2e5
"""A tenth of the speed on a busy machine with the smallest episodes: a file that takes longer counts as hung."""
MEMORY_BYTES = 2 << 30


def validate(path: str | Path) -> tuple[Violation, ...]:
    """Return every violation of the schema in a session's file and in its parts; none if all is well.

    The check runs in a process of its own with a limit on time (a minute, more for files above 12 MB) and memory.
    A file that another program has open, or left marked as open, is not wrong: that raises a DataError.
    """
    file = Path(path)
    for each in (file, *part_files(file.resolve())):
        with suppress(OSError):
            check_state(each)
    try:
        limit_s = max(MIN_LIMIT_S, file.stat().st_size / BYTES_PER_S)
    except OSError:
        limit_s = MIN_LIMIT_S
    try:
        return call_in_sandbox(partial(violations, file), limit_s=limit_s, memory_bytes=MEMORY_BYTES)
    except CallError as error:
        return (Violation(path="/", message=f"{file} cannot be checked: reading it {error}"),)


def violations(path: Path) -> tuple[Violation, ...]:
    """Return what `validate` returns, but check in this process; for files whose bytes are known to be intact."""
    found = Violations()
    parts = part_files(path.resolve())
    if path.exists() or not parts:
        _inspect_file(path, found)
    for part in parts:
        of_part = Violations()
        _inspect_file(part, of_part)
        found += [Violation(path=f"{part.name}:{v.path}", message=v.message) for v in of_part]
    with found.at(log_path(path).name):
        read_log(path)
    for journal in journals(parts_folder(path.resolve())):
        if is_orphaned(journal):
            found.append(Violation(path=journal.name, message="a recording was interrupted here; repair recovers it"))
    return tuple(found)


def _inspect_file(path: Path, found: Violations) -> None:
    before = len(found)
    with found.at("/"), open_file(path) as file, errors_name(path):
        inspect_links(file, found)
        if len(found) == before:
            with found.at(f"/{schema.DATA}"), errors_name(path):
                session = check_session(file)
                infos = _inspect_demos(file, found)
                _inspect_session(file, session, infos, found)


def _inspect_demos(file: h5py.File, found: Violations) -> dict[str, DemoInfo]:
    data, infos = file[schema.DATA], {}
    for name in data:
        where = f"/{schema.DATA}/{name}"
        with found.at(where):
            if not schema.DEMO_NAME.fullmatch(name):
                raise DataError(f"{where} is no demo; all members of /{schema.DATA} must be demo_<number>")
            check_hard_link(data, name)
            try:
                info = _inspect_demo(data, name, found)
            except DataError:
                raise
            except DAMAGE as error:
                raise DataError(f"{where} is damaged ({first_line(error)})") from error
            if info is not None:
                infos[name] = info
    return infos


def _inspect_demo(data: h5py.Group, name: str, found: Violations) -> DemoInfo | None:
    group, before = data[name], len(found)
    if not isinstance(group, h5py.Group):
        raise DataError(f"/{schema.DATA}/{name} is a data set; it must be a group")
    info = inspect_demo(group, found, file_bytes=data.file.id.get_filesize())
    if info is not None:
        inspect_contents(group, info, found)
        _inspect_texts(group, found)
        if len(found) == before:
            read_demo(group, images=False)
    return info


def _inspect_texts(group: h5py.Group, found: Violations) -> None:
    for key, message in texts_violations(group):
        found.append(Violation(path=f"{group.name}@{key}", message=f"{message}; repair writes it again"))


def _inspect_session(
    file: h5py.File, session: dict[str, Attribute], infos: dict[str, DemoInfo], found: Violations
) -> None:
    """Check relations between the demos; totals only where all of them could be read."""
    _inspect_texts(file[schema.DATA], found)
    complete = len(infos) == len(file[schema.DATA])
    n_steps = sum(info.n_steps for info in infos.values())
    if complete and n_steps != session[schema.TOTAL]:
        message = f"is {session[schema.TOTAL]}; the demos have {n_steps} steps together"
        found.append(Violation(path=f"/{schema.DATA}@{schema.TOTAL}", message=message))
    for name, info in infos.items():
        for key, value in info.shared.items():
            if value != session[key]:
                message = f"is {value}; the session's is {session[key]}"
                found.append(Violation(path=f"/{schema.DATA}/{name}@{key}", message=message))
    for uid, count in Counter(info.uid for info in infos.values()).items():
        if count > 1:
            names = ", ".join(name for name, info in infos.items() if info.uid == uid)
            found.append(Violation(path=f"/{schema.DATA}", message=f"{names} have the same uid"))
    _inspect_masks(file, infos, complete, found)
    if complete:
        _inspect_index(file, infos, found)


def _inspect_masks(file: h5py.File, infos: dict[str, DemoInfo], complete: bool, found: Violations) -> None:
    with found.at(f"/{schema.MASK}"):
        masks = read_masks(file, file_bytes=file.id.get_filesize())
        right = masks_of({name: info.outcome for name, info in infos.items()})
        for key, names in masks.items():
            unknown = sorted(set(names) - set(file[schema.DATA]))
            if unknown:
                message = f"names {unknown[0]}, which is not there"
                found.append(Violation(path=f"/{schema.MASK}/{key}", message=message))
            elif complete and key in OWN_MASKS and set(names) != set(right.get(key, ())):
                message = "does not name the demos of that outcome"
                found.append(Violation(path=f"/{schema.MASK}/{key}", message=message))


def _inspect_index(file: h5py.File, infos: dict[str, DemoInfo], found: Violations) -> None:
    if schema.INDEX not in file:
        return
    rows = read_index(file, list(infos), file_bytes=file.id.get_filesize())
    if rows is None:
        message = "is damaged or of other demos; repair writes it again"
        found.append(Violation(path=f"/{schema.INDEX}", message=message))
        return
    for name, row in rows.items():
        if row.info != infos[name] or not _has_content(file[schema.DATA][name], row.content):
            message = f"does not agree with /{schema.DATA}/{name}; repair writes it again"
            found.append(Violation(path=f"/{schema.INDEX}", message=message))


def _has_content(group: h5py.Group, digest: str | None) -> bool:
    """Return whether the digest of the index fits the arrays; what cannot be read is reported with its demo."""
    try:
        return digest in (None, content_of_group(group))
    except DAMAGE:
        return True
