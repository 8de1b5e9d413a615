"""Content of an episode: what makes two episodes the same, wherever they come from.

An episode is the same as another one if its actions, its observations and the cloth's end are the same. Identity,
label, provenance, wall time and images do not count, and numbers are compared as float32, as other tools store them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from layflat.data.format import schema
from layflat.data.types import ACTION_LIMIT_M, Episode, actions_of

SEEN = tuple(field.key for field in schema.OBSERVATION_FIELDS if not field.optional and field.key != "time_s")
"""Observations that count; without the time, which begins at another value in an imported or trimmed episode."""
STEP_KEYS = (schema.ACTIONS, *(f"{schema.OBS}/{key}" for key in SEEN))
CONTENT_KEYS = (*STEP_KEYS, schema.FINAL_STATE)


def content_digest(arrays: Mapping[str, ArrayLike]) -> str:
    """Return the digest of the arrays of a demo, by key of the schema; only those of CONTENT_KEYS count."""
    found = hashlib.sha256()
    for key in CONTENT_KEYS:
        if key in arrays:
            rows = _rounded(arrays[key])
            found.update(f"{key} {rows.shape} ".encode() + rows.tobytes())
    return found.hexdigest()


def content_of_group(group: h5py.Group) -> str:
    """Return the digest of a checked demo of a file."""
    return content_digest({key: group[key][()] for key in CONTENT_KEYS if key in group})


def content_of_episode(episode: Episode) -> str:
    """Return the digest of an episode, which is that of its demo in a file."""
    seen = [step.observation for step in episode.steps]
    arrays: dict[str, Any] = {schema.ACTIONS: actions_of(episode.steps) / ACTION_LIMIT_M}
    arrays |= {f"{schema.OBS}/{key}": [np.ravel(getattr(each, key)) for each in seen] for key in SEEN}
    if episode.final_ground_truth is not None:
        arrays[schema.FINAL_STATE] = episode.final_ground_truth.nodes.ravel()
    return content_digest(arrays)


def copies_among(contents: Mapping[str, str]) -> dict[str, str]:
    """Return each name whose content an earlier one has, with the name of the first."""
    first: dict[str, str] = {}
    return {name: first[digest] for name, digest in contents.items() if first.setdefault(digest, name) != name}


def repeated_steps(
    seeds: Sequence[int], read_steps: Callable[[int], Sequence[ArrayLike]]
) -> tuple[list[int], dict[int, NDArray[np.bool_]]]:
    """Find the episodes that share steps: a trimmed copy and its original, or two that were forked from one.

    Only episodes of the same seed are compared. ``read_steps`` returns the columns, (T, ...) each, of an episode.

    Returns
    -------
    list of int
        For each episode the number of the first one that it belongs to, its own where it shares no step with others.
    dict of int to (T,) bool
        For each episode that belongs to another one, the steps that an earlier one has.
    """
    groups, repeated = list(range(len(seeds))), dict[int, NDArray[np.bool_]]()
    for same in _same_seed(seeds):
        known: dict[bytes, int] = {}
        for number in same:
            steps = _step_bytes(read_steps(number))
            there = np.array([step in known for step in steps], dtype=bool)
            if there.any():
                related = {groups[known[step]] for step in steps if step in known}
                first = min(related)
                groups = [first if group in related or k == number else group for k, group in enumerate(groups)]
                repeated[number] = there
            for step in steps:
                known.setdefault(step, number)
    return groups, repeated


def _same_seed(seeds: Sequence[int]) -> Iterable[list[int]]:
    by_seed: dict[int, list[int]] = {}
    for number, seed in enumerate(seeds):
        by_seed.setdefault(seed, []).append(number)
    return (numbers for numbers in by_seed.values() if len(numbers) > 1)


def _step_bytes(columns: Sequence[ArrayLike]) -> list[bytes]:
    rounded = [_rounded(column) for column in columns]
    return [row.tobytes() for row in np.column_stack([rows.reshape(len(rows), -1) for rows in rounded])]


def _rounded(values: ArrayLike) -> NDArray[np.float32]:
    """Return values as float32; adding zero makes 0.0 of -0.0."""
    with np.errstate(over="ignore"):
        return np.asarray(values, dtype="<f4") + np.float32(0.0)
