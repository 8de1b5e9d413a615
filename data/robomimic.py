"""To robomimic's form and back.

A session already is a robomimic data set; what an export adds is a file of its own, whole and closed, with the filter
keys ``train`` and ``valid`` that robomimic trains by. Nothing is converted, so nothing is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

from data import schema
from data.durable import PART_SUFFIX, written_aside
from data.encode import LIBVER, write_masks, write_session_attributes
from data.store import Session
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
    drawn = np.random.default_rng(seed).choice(len(names), size=count, replace=False) if count else np.zeros(0, int)
    held_out = {names[index] for index in drawn}
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
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    ticks = sum(session.info(name).ticks for name in chosen)
    split = split_names(chosen, valid_share=valid_share, seed=seed)
    groups = dict(session.groups())
    with written_aside(target, target.with_name(f".{target.name}{PART_SUFFIX}")) as aside:
        with h5py.File(aside, "x", libver=LIBVER) as file:
            data = file.create_group(schema.DATA)
            for name in chosen:
                groups[name].file.copy(groups[name], data, name=name)
            write_session_attributes(data, dict(groups[chosen[0]].attrs), total=ticks)
            write_masks(file, {name: session.info(name).outcome for name in chosen})
            for key, members in split.items():
                if members:
                    file.create_dataset(f"{schema.MASK}/{key}", data=np.array([m.encode("ascii") for m in members]))
    return split
