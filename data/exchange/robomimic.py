"""To robomimic's form and back.

A session already is a robomimic data set; what an export adds is a file of its own, whole and closed, with the filter
keys ``train`` and ``valid`` that robomimic trains by. Nothing is converted, so nothing is lost.
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

from layflat.data.atomic_files import PART_SUFFIX, atomic_path
from layflat.data.errors import DataError
from layflat.data.exchange.robomimic_import import imported_episode
from layflat.data.format import schema
from layflat.data.format.encode import AGREED, LIBVER
from layflat.data.format.masks import write_masks
from layflat.data.format.opening import attribute_error_to, open_file
from layflat.data.format.structure_checks import check_hard_links
from layflat.data.session.reader import Session, open_session
from layflat.data.session.session_writer import SessionFile
from layflat.data.tools.operations import filter_session, new_session
from layflat.data.tools.sandbox import CallOutcome, isolated

TRAIN, VALID = "train", "valid"
"""What robomimic calls the two filter keys."""
VALID_SHARE = 0.1
"""robomimic's own default."""
PROBE_S = 60.0
PROBE_BYTES = 1 << 30


def train_and_valid(names: Sequence[str], *, valid_share: float, seed: int) -> dict[str, tuple[str, ...]]:
    """Names for training and for validation, drawn at random, each in its old order.

    Two episodes or more give at least one to each side; where ``valid_share`` is 0 or there is only one episode, there
    is nothing under ``valid``.
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
    session: Session, target: Path, *, names: Iterable[str] | None = None, valid_share: float = VALID_SHARE, seed: int
) -> dict[str, tuple[str, ...]]:
    """Copy episodes, bit by bit, into a robomimic data set at ``target``, and return its training and validation names.

    ``names`` None takes all. The file replaces ``target`` as a whole, or is not there.
    """
    chosen = tuple(session.names if names is None else names)
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    split = train_and_valid(chosen, valid_share=valid_share, seed=seed)
    with (
        atomic_path(target, target.with_name(f".{target.name}{PART_SUFFIX}")) as aside,
        h5py.File(aside, "x", libver=LIBVER) as file,
    ):
        copied = SessionFile(file)
        for name in chosen:
            copied.copy(name, session.group(name), session.info(name))
        copied.finish()
        write_masks(file, {key: members for key, members in split.items() if members})
    return split


@dataclass(frozen=True, kw_only=True)
class Imported:
    """What was made of a foreign file."""

    episodes: int
    exact: bool
    """The file was an intact session, and every demo was copied bit by bit with its identity."""


def import_robomimic(
    path: str | Path, target: str | Path, *, cloth: str | None = None, force: bool = False
) -> Imported:
    """Make the session ``target`` of a robomimic data set in our layout, as a whole or not at all.

    An intact session, such as an export of ours, is copied. Anything else is read demo by demo (see
    layflat.data.exchange.robomimic_import);
    its demos are numbered anew and get identities of their own. ``cloth`` is taken where the file names none.
    """
    source = Path(path)
    if not _intact(source):
        return Imported(episodes=_convert(source, target, cloth, force=force), exact=False)
    return Imported(episodes=len(filter_session(source, target, force=force)), exact=True)


def _intact(path: Path) -> bool:
    """Whether every episode reads as one of ours."""
    try:
        with open_session(path) as session:
            return sum(1 for _ in session.episodes()) > 0
    except DataError:
        return False


def _convert(path: Path, target: str | Path, cloth: str | None, *, force: bool) -> int:
    """Number of episodes that were read and written anew."""
    agreed: dict[str, object] = {}
    count = 0
    _probe(path)
    with ExitStack() as stack:
        file = stack.enter_context(open_file(path))
        with attribute_error_to(path):
            demos = _demos(file)
        written = stack.enter_context(new_session(target, force=force))
        for group in demos:
            with attribute_error_to(path):
                episode = imported_episode(group, file=path, cloth=cloth)
                for key in AGREED:
                    if agreed.setdefault(key, getattr(episode, key)) != getattr(episode, key):
                        raise DataError(f"{group.name} has {key} {getattr(episode, key)}; others have {agreed[key]}")
            written.add(schema.demo_name(count), episode, uuid.uuid4().hex)
            count += 1
    return count


def _probe(path: Path) -> None:
    """Other programs' text lies where damage may keep HDF5 in a loop for ever (layflat.data.format.attributes): not
    here, then."""
    open_file(path).close()
    try:
        isolated(partial(_read_attributes, path), limit_s=PROBE_S, memory_bytes=PROBE_BYTES)
    except CallOutcome as error:
        raise DataError(f"{path} cannot be used: reading its attributes {error}") from None


def _read_attributes(path: Path) -> None:
    with h5py.File(path, "r") as file:
        for group in (file[schema.DATA], *_demos(file)):
            for key in group.attrs:
                group.attrs[key]


def _demos(file: h5py.File) -> list[h5py.Group]:
    check_hard_links(file)
    data = file.get(schema.DATA)
    if not isinstance(data, h5py.Group) or len(data) == 0:
        raise DataError("has no group /data with demos in it")
    check_hard_links(data)
    for name in data:
        if not schema.DEMO_NAME.fullmatch(name) or not isinstance(data[name], h5py.Group):
            raise DataError(f"/data/{name} is no demo; all members of /data must be demo_<number>")
    return [data[name] for name in sorted(data, key=schema.demo_number)]
