"""Exports to robomimic, and imports from it.

A session already is a robomimic data set; an export adds the filter keys ``train`` and ``valid`` that robomimic trains
by. Nothing is converted, so nothing is lost.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from layflat.data.atomic_files import atomic_path
from layflat.data.errors import DataError
from layflat.data.exchange.idle_end import kept_steps, without_idle_end
from layflat.data.exchange.robomimic_import import import_episode
from layflat.data.format import schema
from layflat.data.format.attributes import texts_violations
from layflat.data.format.encode import shared_attributes
from layflat.data.format.h5_writing import written_file
from layflat.data.format.masks import write_masks
from layflat.data.format.opening import demo_names, errors_name, open_file
from layflat.data.format.structure_checks import check_hard_links
from layflat.data.robot import RobotSpec
from layflat.data.sandbox import CallError, call_in_sandbox
from layflat.data.session.edit_log import log_path
from layflat.data.session.reader import Session, open_session
from layflat.data.session.session_writer import SessionFile
from layflat.data.tools.operations import filter_session, new_session, with_copies

TRAIN, VALID = "train", "valid"
"""robomimic's names of the two filter keys."""
VALID_SHARE = 0.1
"""robomimic's own default."""
PROBE_S = 60.0
PROBE_BYTES = 1 << 30


def train_and_valid(names: Sequence[str], *, valid_share: float, seed: int) -> dict[str, tuple[str, ...]]:
    """Draw names for training and for validation at random, each in the old order.

    Two episodes or more give at least one to each side; with a ``valid_share`` of 0 or only one episode ``valid`` is
    empty.
    """
    if not 0 <= valid_share < 1:
        raise DataError(f"the share for validation is {valid_share}; it must be at least 0 and below 1")
    count = max(round(valid_share * len(names)), int(valid_share > 0))
    count = max(min(count, len(names) - 1), 0)
    held_out = {names[index] for index in np.random.default_rng(seed).permutation(len(names))[:count].tolist()}
    return {
        TRAIN: tuple(name for name in names if name not in held_out),
        VALID: tuple(name for name in names if name in held_out),
    }


def export_robomimic(
    session: Session,
    target: Path,
    *,
    names: Iterable[str] | None = None,
    valid_share: float = VALID_SHARE,
    seed: int,
    trim_idle: bool = False,
) -> dict[str, tuple[str, ...]]:
    """Copy episodes, bit by bit, into a robomimic data set at ``target``, and return its training and validation names.

    ``names`` None takes all. With ``trim_idle`` only one step of an idle end is copied; the outcome stays. Copies, and
    episodes that share steps, are on the same side. The file replaces ``target`` completely, or not at all.
    """
    chosen = tuple(session.names if names is None else names)
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    recordings = session.recordings(chosen)
    drawn = train_and_valid(tuple(dict.fromkeys(recordings.values())), valid_share=valid_share, seed=seed)
    split = {key: with_copies(members, recordings) for key, members in drawn.items()}
    with atomic_path(target) as aside, written_file(aside) as (file, check):
        copied = SessionFile(file, check=check)
        for name in chosen:
            info, stop = session.info(name), kept_steps(session, name, trim_idle=trim_idle)
            if stop == info.n_steps:
                session.copy_to(copied, name)
            else:
                copied.add(name, without_idle_end(session.episode(name), stop), info.uid)
        copied.finish()
        write_masks(file, {key: members for key, members in split.items() if members})
    log_path(target).unlink(missing_ok=True)  # It edited what was replaced.
    return split


@dataclass(frozen=True, kw_only=True)
class ImportReport:
    """Result of an import."""

    episodes: int
    exact: bool
    """Whether the file was an intact session, so that every demo was copied bit by bit with its identity."""


def import_robomimic(
    path: str | Path,
    target: str | Path,
    *,
    cloth: str | None = None,
    robots: Sequence[RobotSpec] = (),
    force: bool = False,
) -> ImportReport:
    """Write the session ``target`` from a robomimic data set in our layout, completely or not at all.

    An intact session, such as an export of ours, is copied. Anything else is read demo by demo (see
    layflat.data.exchange.robomimic_import); its demos are renumbered and get new identities. ``cloth`` is used where
    the file names none, ``robots`` where it does not describe its robot.
    """
    source = Path(path)
    if _is_intact(source):
        return ImportReport(episodes=len(filter_session(source, target, force=force)), exact=True)
    _probe(source)
    shared: dict[str, object] = {}
    with ExitStack() as stack:
        file = stack.enter_context(open_file(source))
        with errors_name(source):
            demos = _demos(file)
        written = stack.enter_context(new_session(target, force=force))
        for number, group in enumerate(demos):
            with errors_name(source):
                episode = import_episode(group, file=source, cloth=cloth, robots=robots)
                for key, value in shared_attributes(episode).items():
                    if shared.setdefault(key, value) != value:
                        raise DataError(f"{group.name} has {key} {value}; others have {shared[key]}")
            written.add(schema.demo_name(number), episode, uuid.uuid4().hex)
    return ImportReport(episodes=len(demos), exact=False)


def _is_intact(path: Path) -> bool:
    """Return whether every episode reads as one of ours."""
    try:
        with open_session(path, edits=False) as session:
            read = sum(1 for _ in session.episodes())
        return read > 0 and call_in_sandbox(partial(_texts_agree, path), limit_s=PROBE_S, memory_bytes=PROBE_BYTES)
    except (DataError, CallError):
        return False


def _texts_agree(path: Path) -> bool:
    """Return whether no tool has changed a text attribute."""
    with open_file(path) as file:
        return not any(texts_violations(group) for group in (file[schema.DATA], *_demos(file)))


def _probe(path: Path) -> None:
    """Read all attributes in a sandbox: damage in other programs' text may keep HDF5 in an endless loop."""
    open_file(path).close()
    try:
        call_in_sandbox(partial(_read_attributes, path), limit_s=PROBE_S, memory_bytes=PROBE_BYTES)
    except CallError as error:
        raise DataError(f"{path} cannot be used: reading its attributes {error}") from None


def _read_attributes(path: Path) -> None:
    with open_file(path) as file:
        for group in (file[schema.DATA], *_demos(file)):
            for key in group.attrs:
                group.attrs[key]


def _demos(file: h5py.File) -> list[h5py.Group]:
    check_hard_links(file)
    data = file.get(schema.DATA)
    if not isinstance(data, h5py.Group) or len(data) == 0:
        raise DataError("has no group /data with demos in it")
    check_hard_links(data)
    groups = [data[name] for name in demo_names(data)]
    for group in groups:
        if not isinstance(group, h5py.Group):
            raise DataError(f"{group.name} is a data set; it must be a group")
    return groups
