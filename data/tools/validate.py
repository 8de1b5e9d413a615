"""Finds everything that is wrong with a session, whatever its bytes are: `validate` never crashes, hangs or raises."""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path

import h5py

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.decode import read_demo
from layflat.data.format.masks import OURS, masks_of, read_masks
from layflat.data.format.opening import DAMAGE, attribute_error_to, check_session, open_file, part_files, parts_folder
from layflat.data.format.structure_checks import Violation, Violations, check_hard_link, inspect_demo, inspect_links
from layflat.data.format.value_checks import inspect_contents
from layflat.data.session.demo_info import DemoInfo
from layflat.data.session.index import IndexLine, read_index
from layflat.data.session.journal_reader import journals, orphaned_journals
from layflat.data.tools.sandbox import CallOutcome, isolated

__all__ = ["Violation", "validate"]

LEAST_LIMIT_S = 60.0
BYTES_PER_S = 2e5
"""A tenth of what a busy machine checks of the smallest episodes: a file that takes longer counts as hung."""
MEMORY_BYTES = 2 << 30


def validate(path: str | Path) -> tuple[Violation, ...]:
    """Every violation of the schema in a session's file and in the episodes that wait beside it; none if all is well.

    Works in a process of its own with a limit on time (a minute, more for files above 12 MB) and memory.
    """
    file = Path(path)
    try:
        limit_s = max(LEAST_LIMIT_S, file.stat().st_size / BYTES_PER_S)
    except OSError:
        limit_s = LEAST_LIMIT_S
    try:
        return isolated(partial(violations, file), limit_s=limit_s, memory_bytes=MEMORY_BYTES)
    except CallOutcome as error:
        return (Violation(path="/", sentence=f"{file} cannot be checked: reading it {error}"),)


def violations(path: Path) -> tuple[Violation, ...]:
    """As validate, here and now; for files whose bytes are known to be whole."""
    found = Violations()
    parts = part_files(path.resolve())
    if path.exists() or not parts:
        _inspect_file(path, found)
    for part in parts:
        of_part = Violations()
        _inspect_file(part, of_part)
        found += [Violation(path=f"{part.name}:{v.path}", sentence=v.sentence) for v in of_part]
    for journal in journals(parts_folder(path.resolve())):
        if orphaned_journals(journal):
            found.append(Violation(path=journal.name, sentence="a recording was cut short here; repair brings it back"))
    return tuple(found)


def _inspect_file(path: Path, found: Violations) -> None:
    before = len(found)
    with found.at("/"), open_file(path) as file, attribute_error_to(path):
        inspect_links(file, found)
        if len(found) == before:
            with found.at(f"/{schema.DATA}"), attribute_error_to(path):
                session = check_session(file)
                infos = _inspect_demos(file, found)
                _inspect_session(file, dict(session), infos, found)


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
                reason = (str(error).splitlines() or [type(error).__name__])[0]
                raise DataError(f"{where} is damaged ({reason})") from error
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
        if len(found) == before:
            read_demo(group, images=False)
    return info


def _inspect_session(
    file: h5py.File, session: dict[str, object], infos: dict[str, DemoInfo], found: Violations
) -> None:
    """What lies between the demos; only where all of them could be read is a total of use."""
    complete = len(infos) == len(file[schema.DATA])
    n_steps = sum(info.n_steps for info in infos.values())
    if complete and n_steps != session[schema.TOTAL]:
        sentence = f"is {session[schema.TOTAL]}; the demos have {n_steps} steps together"
        found.append(Violation(path=f"/{schema.DATA}@{schema.TOTAL}", sentence=sentence))
    agreed = (schema.ROBOT, schema.CLOTH, schema.STEP_S, schema.DESCRIPTOR)
    for name, info in infos.items():
        for key in agreed:
            if getattr(info, key) != session[key]:
                sentence = f"is {getattr(info, key)}; the session's is {session[key]}"
                found.append(Violation(path=f"/{schema.DATA}/{name}@{key}", sentence=sentence))
    for uid, count in Counter(info.uid for info in infos.values()).items():
        if count > 1:
            names = ", ".join(name for name, info in infos.items() if info.uid == uid)
            found.append(Violation(path=f"/{schema.DATA}", sentence=f"{names} have the same uid"))
    _inspect_masks(file, infos, complete, found)
    _inspect_index(file, infos, complete, found)


def _inspect_masks(file: h5py.File, infos: dict[str, DemoInfo], complete: bool, found: Violations) -> None:
    with found.at(f"/{schema.MASK}"):
        masks = read_masks(file, file_bytes=file.id.get_filesize())
        right = masks_of({name: info.outcome for name, info in infos.items()})
        for key, names in masks.items():
            unknown = sorted(set(names) - set(file[schema.DATA]))
            if unknown:
                sentence = f"names {unknown[0]}, which is not there"
                found.append(Violation(path=f"/{schema.MASK}/{key}", sentence=sentence))
            elif complete and key in OURS and set(names) != set(right.get(key, ())):
                sentence = "does not name the demos of that outcome"
                found.append(Violation(path=f"/{schema.MASK}/{key}", sentence=sentence))


def _inspect_index(file: h5py.File, infos: dict[str, DemoInfo], complete: bool, found: Violations) -> None:
    if schema.INDEX not in file or not complete:
        return
    lines: dict[str, IndexLine] | None = read_index(file, list(infos), file_bytes=file.id.get_filesize())
    if lines is None:
        sentence = "is damaged or of other demos; repair makes it anew"
        found.append(Violation(path=f"/{schema.INDEX}", sentence=sentence))
        return
    for name, line in lines.items():
        if line.info != infos[name]:
            sentence = f"does not agree with /{schema.DATA}/{name}; repair makes it anew"
            found.append(Violation(path=f"/{schema.INDEX}", sentence=sentence))
