"""Reads journals: the episode of a killed recording, as far as it got."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, robot_of
from layflat.data.format.decode import decode_episode, disturbances_of
from layflat.data.format.encode import disturbances_json
from layflat.data.session.journal import DISTURBANCES, END, FRAME, MAGIC, START, STEP, UNRELEASED_MAGIC, record_dtype
from layflat.data.system_errors import os_reason
from layflat.data.types import Episode, StoppedBy, disturbances_within

RECORD_BYTES_MAX = 1 << 28


@dataclass(frozen=True, kw_only=True)
class RecoveredEpisode:
    """The episode in a journal."""

    uid: str
    episode: Episode
    complete: bool
    """Whether the episode had ended; otherwise its outcome is ``partial``."""


def read_journal(path: Path, *, stopped_by: StoppedBy = "crashed") -> RecoveredEpisode | None:
    """Return the episode of a journal up to its last complete frame, or None where not even one step was finished.

    The observation at the start of the last step becomes the final one: the result of that step is not known.
    ``stopped_by`` is that of an episode whose end is missing.
    """
    try:
        return _recovered(list(_frames(path.read_bytes())), stopped_by)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_reason(error)}") from error
    except DataError as error:
        raise DataError(f"{path} cannot be used: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError, MemoryError, RecursionError) as error:
        raise DataError(f"{path} is no journal of this layflat ({error})") from error


def _frames(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of every complete frame before the first that is not."""
    if content.startswith(UNRELEASED_MAGIC):
        raise DataError("it was written by an unreleased version of layflat; delete it and record again")
    if not content.startswith(MAGIC):
        return
    at = len(MAGIC)
    while at + FRAME.size <= len(content):
        length, checksum, kind = FRAME.unpack_from(content, at)
        frame = content[at + FRAME.size : at + FRAME.size + length]
        if len(frame) < length or zlib.crc32(frame, zlib.crc32(kind)) != checksum:
            return
        yield kind, frame
        at += FRAME.size + length


def _recovered(frames: list[tuple[bytes, bytes]], stopped_by: StoppedBy) -> RecoveredEpisode | None:
    if not frames or frames[0][0] != START:
        return None
    header = json.loads(frames[0][1])
    attributes: dict[str, Attribute] = header["attributes"]
    if attributes[schema.VERSION] != schema.SCHEMA_VERSION:
        raise DataError(
            f"it is of version {attributes[schema.VERSION]} of the format; this layflat reads {schema.SCHEMA_VERSION}"
        )
    dtype = record_dtype(robot_of(attributes), header["lengths"])
    if not 0 < dtype.itemsize <= RECORD_BYTES_MAX:
        raise DataError(f"a step has {dtype.itemsize} bytes; {RECORD_BYTES_MAX} is the most that is read")
    records = [content for kind, content in frames if kind == STEP]
    end = next((content for kind, content in frames if kind == END), None)
    final: dict[str, Attribute] = {} if end is None else json.loads(end[dtype.itemsize :])
    # A step that was refused before the end is missing.
    complete = final.get(schema.NUM_SAMPLES) == len(records)
    if end is not None and complete:
        records.append(end[: dtype.itemsize])
        attributes = final
    else:
        disturbances = next((content for kind, content in reversed(frames) if kind == DISTURBANCES), None)
        if disturbances is not None:
            attributes[schema.DISTURBANCES] = disturbances.decode("ascii")
        attributes |= {schema.OUTCOME: "partial", schema.STOPPED_BY: stopped_by}
    if len(records) < 2:
        return None
    rows = np.frombuffer(b"".join(records), dtype)
    # The last disturbance may have started after the last finished step.
    within = disturbances_within(disturbances_of(attributes), 0, len(rows) - 1)
    attributes |= {
        schema.DISTURBANCES: disturbances_json(within),
        schema.WALL_S: float(rows["wall_s"][-1]),
    }
    episode = decode_episode(attributes, {key: rows[key] for key in dtype.names or ()}, header["joints"])
    return RecoveredEpisode(uid=str(attributes[schema.UID]), episode=episode, complete=complete)
