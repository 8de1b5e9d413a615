"""To robomimic's form and back.

A session already is a robomimic data set; what an export adds is a file of its own, whole and closed, with the filter
keys ``train`` and ``valid`` that robomimic trains by. Nothing is converted, so nothing is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from data import schema
from data.decode import check_hard_links
from data.durable import PART_SUFFIX, written_aside
from data.encode import LIBVER, write_masks, write_session_attributes
from data.importing import imported_episode
from data.recorder import SessionRecorder
from data.store import Session, open_session
from data.types import DataError

TRAIN, VALID = "train", "valid"
"""What robomimic calls the two filter keys."""
VALID_SHARE = 0.1
"""robomimic's own default."""


def split_names(names: Sequence[str], *, valid_share: float, seed: int) -> dict[str, tuple[str, ...]]:
    """Names for training and for validation, drawn at random, each in its old order.

    Two episodes or more give at least one to each side; where ``valid_share`` is 0 or there is only one episode, there
    is nothing under ``valid``.
    """
    if not 0 <= valid_share < 1:
        raise DataError(f"the share for validation is {valid_share}; it must be at least 0 and below 1")
    count = round(valid_share * len(names))
    if valid_share > 0 and len(names) > 1:
        count = min(max(count, 1), len(names) - 1)
    held_out = {names[index] for index in np.random.default_rng(seed).permutation(len(names))[:count].tolist()}
    return {
        TRAIN: tuple(name for name in names if name not in held_out),
        VALID: tuple(name for name in names if name in held_out),
    }


def export_robomimic(
    session: Session, target: Path, *, names: Iterable[str] | None = None, valid_share: float = VALID_SHARE, seed: int
) -> Mapping[str, tuple[str, ...]]:
    """Copy episodes, bit by bit, into a robomimic data set at ``target``, and return its training and validation names.

    ``names`` None takes all. The file replaces ``target`` as a whole, or is not there.
    """
    chosen = tuple(session.names if names is None else names)
    split = split_names(chosen, valid_share=valid_share, seed=seed)
    with written_aside(target, target.with_name(f".{target.name}{PART_SUFFIX}")) as aside:
        _copy(session, chosen, aside, split)
    return split


@dataclass(frozen=True, kw_only=True)
class Imported:
    """What was made of a foreign file."""

    episodes: int
    exact: bool
    """The file was an intact session, and every demo was copied bit by bit with its identity."""


def import_robomimic(path: Path, target: Path, *, cloth: str | None = None) -> Imported:
    """Make the session ``target`` of a robomimic data set in our layout, as a whole or not at all.

    An intact session, such as an export of ours, is copied. Anything else is read demo by demo (see data.importing);
    its demos are numbered anew and get identities of their own. ``cloth`` is taken where the file names none.
    """
    try:
        session = open_session(path)
    except DataError:
        return Imported(episodes=_convert(path, target, cloth), exact=False)
    with session, written_aside(target, target.with_name(f".{target.name}{PART_SUFFIX}")) as aside:
        _copy(session, session.names, aside, {})
    return Imported(episodes=len(session), exact=True)


def _copy(session: Session, names: Sequence[str], aside: Path, masks: Mapping[str, Sequence[str]]) -> None:
    """A new file with these demos, our own filter keys, and ``masks``."""
    if not names:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to write")
    groups = dict(session.groups())
    with h5py.File(aside, "x", libver=LIBVER) as file:
        data = file.create_group(schema.DATA)
        for name in names:
            groups[name].file.copy(groups[name], data, name=name)
        ticks = sum(session.info(name).ticks for name in names)
        write_session_attributes(data, dict(groups[names[0]].attrs), total=ticks)
        write_masks(file, {name: session.info(name).outcome for name in names})
        for key, members in masks.items():
            if members:
                file.create_dataset(f"{schema.MASK}/{key}", data=np.array([m.encode("ascii") for m in members]))


def _convert(path: Path, target: Path, cloth: str | None) -> int:
    """Number of episodes that were read and written anew."""
    count = 0
    with _blaming(path), ExitStack() as stack:
        file = stack.enter_context(h5py.File(path, "r"))
        aside = stack.enter_context(written_aside(target, target.with_name(f".{target.stem}{PART_SUFFIX}.h5")))
        recorder: SessionRecorder | None = None
        with ExitStack() as open_recorder:
            for group in _demos(file):
                episode = imported_episode(group, file=path, cloth=cloth)
                recorder = recorder or open_recorder.enter_context(
                    SessionRecorder(aside, task=episode.task, cloth=episode.cloth, keep_images=True)
                )
                recorder.keep(episode)
                count += 1
    return count


def _demos(file: h5py.File) -> list[h5py.Group]:
    check_hard_links(file)
    data = file.get(schema.DATA)
    if not isinstance(data, h5py.Group) or len(data) == 0:
        raise DataError("there is no group /data with demos in it")
    check_hard_links(data)
    for name in data:
        if not schema.DEMO_NAME.fullmatch(name) or not isinstance(data[name], h5py.Group):
            raise DataError(f"/data/{name} is no demo; all members of /data must be demo_<number>")
    return [data[name] for name in sorted(data, key=schema.demo_number)]


@contextmanager
def _blaming(path: Path) -> Iterator[None]:
    """Whatever is wrong with the file in one sentence that names it."""
    try:
        yield
    except DataError as error:
        raise DataError(f"{path} cannot be imported: {error}") from error
    except FileNotFoundError:
        raise DataError(f"{path} does not exist; correct the path") from None
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise DataError(f"{path} cannot be imported: it is no HDF5 file, or damaged ({reason})") from error
