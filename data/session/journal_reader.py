"""Reads journals back: the episode of a recording that was killed, as far as it went."""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from layflat.data.atomic_files import lock_until_exit, unlock
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute
from layflat.data.format.decode import TOLD_BY_FEW, drag_of, hand_of, observations_of, without_steps
from layflat.data.format.migrate import from_2
from layflat.data.session.journal import BEGINNING, DISTURBED, END, FRAME, MAGIC, STEP, record_dtype
from layflat.data.types import Episode, GroundTruth, Observation, Phase, Step, StoppedBy, disturbances_within

JOURNAL_GLOB = "running-*.journal"
READ_VERSIONS = (2, schema.SCHEMA_VERSION)
"""Of a journal; version 1 had none."""
HEADER_BYTES_MAX = 1 << 24
RECORD_BYTES_MAX = 1 << 28


@dataclass(frozen=True, kw_only=True)
class RecoveredEpisode:
    """What a journal holds."""

    uid: str
    episode: Episode
    whole: bool
    """Whether the episode had ended; else its outcome is ``partial``."""


def journals(folder: Path) -> list[Path]:
    """Journals in a session's folder of parts, whether their writers live or not."""
    return sorted(folder.glob(JOURNAL_GLOB)) if folder.is_dir() else []


def journal_path(folder: Path, uid: str) -> Path:
    return folder / JOURNAL_GLOB.replace("*", uid)


def orphaned_journals(path: Path) -> bool:
    """Whether no process writes to this journal any more."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        lock_until_exit(descriptor)
    except BlockingIOError:
        os.close(descriptor)
        return False
    unlock(descriptor)
    return True


def read_journal(path: Path, *, stopped_by: StoppedBy = "crashed") -> RecoveredEpisode | None:
    """The episode of a journal up to its last whole frame; None where not even one step was over.

    The observation that the last step began with becomes the final one: what that step led to is not known.
    ``stopped_by`` is what the episode is to say where its end is missing.
    """
    try:
        frames = list(_frames(path.read_bytes()))
        return _recovered(frames, stopped_by)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}") from error
    except DataError as error:
        raise DataError(f"{path} cannot be used: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError, MemoryError, RecursionError) as error:
        raise DataError(f"{path} is no journal of this layflat ({error})") from error


def _frames(text: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of every whole frame before the first that is not."""
    if not text.startswith(MAGIC):
        return
    at = len(MAGIC)
    while at + FRAME.size <= len(text):
        length, checksum, kind = FRAME.unpack_from(text, at)
        content = text[at + FRAME.size : at + FRAME.size + length]
        if len(content) < length or zlib.crc32(content, zlib.crc32(kind)) != checksum:
            return
        yield kind, content
        at += FRAME.size + length


def _recovered(frames: list[tuple[bytes, bytes]], stopped_by: StoppedBy) -> RecoveredEpisode | None:
    if not frames or frames[0][0] != BEGINNING:
        return None
    header = json.loads(frames[0][1])
    attributes: dict[str, Attribute] = header["attributes"]
    version = attributes[schema.VERSION]
    if version not in READ_VERSIONS:
        raise DataError(f"it is of version {version} of the format, not {' or '.join(map(str, READ_VERSIONS))}")
    dtype = record_dtype(header["lengths"], int(version))
    if not 0 < dtype.itemsize <= RECORD_BYTES_MAX:
        raise DataError(f"a step of {dtype.itemsize} bytes cannot be")
    n_steps = [content for kind, content in frames if kind == STEP]
    end = next((content for kind, content in frames if kind == END), None)
    last = attributes if end is None else json.loads(end[dtype.itemsize :])
    if end is not None and last[schema.NUM_SAMPLES] == len(n_steps):
        n_steps.append(end[: dtype.itemsize])
        attributes = last
    else:
        end = None  # A step was refused before the end.
    if len(n_steps) < 2:
        return None
    records = np.frombuffer(b"".join(n_steps), dtype)
    befell = next((content for kind, content in reversed(frames) if kind == DISTURBED), None)
    if end is None and befell is not None:
        attributes = attributes | {schema.DISTURBANCES: befell.decode("ascii")}
    if version == 2:
        # Of the step that was going on, its phase is known: whether a disturbance was over.
        phases = records["phase"][: None if end is None else -1]
        attributes = from_2(attributes if end is not None else attributes | {schema.STOPPED_BY: stopped_by}, phases)
    episode = _episode(attributes, records, header["joints"])
    if end is None:
        episode = replace(episode, outcome="partial", stopped_by=stopped_by)
    return RecoveredEpisode(uid=str(attributes[schema.UID]), episode=episode, whole=end is not None)


def _episode(attributes: Mapping[str, Attribute], records: NDArray[Any], joints: list[float]) -> Episode:
    """The last record is the state after the last step."""
    observations, ground_truths = _observations(records), _truths(records)
    episode = without_steps(attributes, observations[-1], ground_truths[-1])
    told = set(records.dtype.names or ()) >= {*TOLD_BY_FEW}
    steps = tuple(
        Step(
            observation=observation,
            ground_truth=ground_truth,
            action=record["action_m"],
            action_std=None if np.isnan(record["action_std"]).all() else record["action_std"],
            phase=cast(Phase, bytes(record["phase"]).decode("ascii")),
            **(_told_by_few(record) if told else {}),
        )
        for observation, ground_truth, record in zip(observations[:-1], ground_truths[:-1], records, strict=False)
    )
    return replace(
        episode,
        steps=steps,
        disturbances=disturbances_within(episode.disturbances, 0, len(steps)),
        wall_s=float(records[-1]["wall_s"]),
        initial_joints=np.array(joints),
    )


def _told_by_few(record: NDArray[Any]) -> dict[str, Any]:
    return {
        "drag": drag_of(int(record[schema.PULL_NODE]), record[schema.PULL_TARGET]),
        "force_n": record[schema.FORCE],
        "intervention": bool(record[schema.INTERVENTION]),
        "hand_m": hand_of(record[schema.HAND]),
    }


def _observations(records: NDArray[Any]) -> list[Observation]:
    names = set(records.dtype.names or ())
    keys = [field.key for field in schema.OBSERVATION_FIELDS if field.key in names]
    return observations_of({key: records[key] for key in keys})


def _truths(records: NDArray[Any]) -> list[GroundTruth]:
    return [
        GroundTruth(
            nodes=record["nodes"],
            contact_portion_true=float(record["contact_portion_true"]),
            flat_area=float(record["flat_area"]),
        )
        for record in records
    ]


def remove(path: Path) -> None:
    """A journal that is not needed any more."""
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
