"""The running episode's journal: an append-only file that gives back all but the last second of a killed recording.

``FILE.h5.parts/running-<uid>.journal`` is made of frames, each with the length and the checksum (CRC-32) of its bytes:
first what is known when an episode begins, then one for each step, at last one that says how it ended. Where a
disturbance begins or is over, a frame between two steps says what befell the cloth so far. A frame that is not whole
ends the journal. Whoever writes it holds it locked.

A thread of its own packs, writes and, twice a second, flushes to the disk: the loop's thread only hands over what is
frozen anyway. Images are written as they are: half a megabyte a step for the seconds of an episode, at less than what
packing them would cost. When the disk is full, the next step says so, and what was written remains.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import struct
import threading
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from layflat.data.atomic_files import fsync_path, fsync_write, lock_until_exit, os_reason, unlock
from layflat.data.errors import DataError, WriteError
from layflat.data.format import schema
from layflat.data.format.encode import attributes_of, disturbances_text, hand_row
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.session.session_writer import serialize
from layflat.data.types import ACTION_LIMIT_M, DisturbanceRecord, Episode, GroundTruth, Observation, Step

MAGIC = b"LAYFLAT journal 1\n"
FRAME = struct.Struct("<IIc")
"""Bytes of content, CRC-32 of kind and content, kind."""
BEGINNING, STEP, END, DISTURBED = b"B", b"T", b"E", b"D"
SYNC_S = 0.5
"""Wall time after which what was written is flushed to the disk; with the flush itself well below a second."""
WAITING_MAX = 64
"""Steps that may wait to be written before the loop has to wait: about 32 MB with images, six seconds of a person."""


@dataclass(frozen=True, kw_only=True)
class JournalHandle:
    """Leave to write one running episode beside a session; may be handed to another process."""

    path: Path
    uid: str
    save_images: bool

    name: str
    """Name in the session, ``demo_<int>``, that is reserved for the episode."""
    session: Path
    """The session's file."""

    def save(self, episode: Episode) -> SavedEpisode:
        """Save the whole episode as a part of the session, durable on return, and remove its journal.

        For the process in which the episode ran; its recorder must then `SessionRecorder.register` it.
        """
        image = serialize(self.name, episode, self.uid, save_images=self.save_images)
        try:
            fsync_write(self.path.parent / f"{self.name}.h5", image)
        except OSError as error:
            raise WriteError(
                f"{self.session} cannot be written: {os_reason(error)}; the episodes before are safe"
            ) from error
        self.path.unlink(missing_ok=True)
        return SavedEpisode(
            name=self.name,
            path=self.session,
            n_steps=len(episode.steps),
            size_bytes=len(image),
            outcome=episode.outcome,
            contact_final=episode.final_observation.contact_portion,
            step_s=episode.step_s,
            descriptor=episode.descriptor,
        )

    def open(self, beginning: Episode) -> JournalWriter:
        """``beginning``: the episode as far as it is known, without steps; its final observation is the first one."""
        return JournalWriter(self, beginning)


class _Step(NamedTuple):
    step: Step
    wall_s: float


class _Last(NamedTuple):
    observation: Observation
    ground_truth: GroundTruth
    wall_s: float
    attributes: bytes


class _Disturbed(NamedTuple):
    text: bytes


_Item: TypeAlias = _Step | _Last | _Disturbed


class JournalWriter:
    """Writes one running episode; a hook of the loop."""

    def __init__(self, ticket: JournalHandle, beginning: Episode) -> None:
        self.ticket = ticket
        self._began = time.monotonic()
        self._size = beginning.robot.size
        self._lengths = lengths_of(beginning, save_images=ticket.save_images)
        self._dtype = record_dtype(self._lengths)
        self._problem: DataError | None = None
        self._closed = False
        self._n_steps = 0
        header = {
            "attributes": attributes_of(beginning, ticket.uid),
            "lengths": self._lengths,
            "joints": beginning.initial_joints.tolist(),
        }
        self._open(json.dumps(header).encode("ascii"))
        self._queue: queue.Queue[_Item | None] = queue.Queue(WAITING_MAX)
        self._thread = threading.Thread(target=self._write_on, name="journal", daemon=True)
        self._thread.start()

    def step(self, step: Step) -> None:
        """Hand over one step; DataError where the journal cannot be written any more, or the step does not fit."""
        if self._problem is not None:
            raise self._problem
        if step.action.shape != (self._size,) or np.abs(step.action).max() > ACTION_LIMIT_M:
            raise DataError(f"the action is {step.action}; it must be {self._size} numbers within +-{ACTION_LIMIT_M} m")
        self._check_fits(step.observation, known(step.ground_truth))
        self._queue.put(_Step(step, time.monotonic() - self._began))
        self._n_steps += 1

    def on_step(self, step: Step, step_index: int) -> None:
        """As a hook of the loop."""
        self.step(step)

    def on_disturbance(self, records: Sequence[DisturbanceRecord]) -> None:
        """All that has befallen the cloth so far, in terms of the steps that have been handed over."""
        if self._problem is not None:
            raise self._problem
        self._queue.put(_Disturbed(disturbances_text(records).encode("ascii")))

    def finish(self, episode: Episode) -> None:
        """Say how it ended: from now on the journal gives back the whole episode. Never raises: it is told by keep."""
        with contextlib.suppress(DataError):
            # The loop's hooks do not hear of a step that ended in instability.
            for step in episode.steps[self._n_steps :]:
                self.step(step)
            self._check_fits(episode.final_observation, known(episode.final_ground_truth))
            attributes = json.dumps(attributes_of(episode, self.ticket.uid)).encode("ascii")
            self._queue.put(
                _Last(episode.final_observation, known(episode.final_ground_truth), episode.wall_s, attributes)
            )
        self.close()

    def close(self) -> None:
        """Returns when all that was handed over is on the disk, as far as it had room."""
        if self._closed:
            return
        self._closed = True
        self._queue.put(None)
        self._thread.join()
        unlock(self._descriptor)

    def _open(self, header: bytes) -> None:
        path = self.ticket.path
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise self._failed(error) from error
        try:
            lock_until_exit(self._descriptor)
            write_all(self._descriptor, MAGIC)
            write_all(self._descriptor, *frame(BEGINNING, header))
            os.fsync(self._descriptor)
            fsync_path(path.parent)
        except OSError as error:
            unlock(self._descriptor)
            path.unlink()
            raise self._failed(error) from error

    def _check_fits(self, observation: Observation, ground_truth: GroundTruth) -> None:
        lengths = _lengths(observation, ground_truth, self._size, save_images=self.ticket.save_images)
        if lengths != self._lengths:
            raise DataError(f"the step has {lengths}; the episode began with {self._lengths}")

    def _write_on(self) -> None:
        unsynced_since: float | None = None
        while True:
            wait_s = None if unsynced_since is None else max(0.0, unsynced_since + SYNC_S - time.monotonic())
            item: _Item | None = None
            late = False
            try:
                item = self._queue.get(timeout=wait_s)
            except queue.Empty:
                late = True
            ended = item is None and not late
            try:
                if item is not None and self._problem is None:
                    write_all(self._descriptor, *self._frame(item))
                    unsynced_since = unsynced_since or time.monotonic()
                due = unsynced_since is not None and time.monotonic() >= unsynced_since + SYNC_S
                if unsynced_since is not None and (ended or due):
                    unsynced_since = None
                    os.fsync(self._descriptor)
            except Exception as error:  # Whatever it is, the loop must hear of it instead of waiting for this thread.
                self._problem, unsynced_since = self._failed(error), None
            if ended:
                return

    def _frame(self, item: _Item) -> tuple[bytes, bytes]:
        if isinstance(item, _Disturbed):
            return frame(DISTURBED, item.text)
        record = np.zeros((), self._dtype)
        record["wall_s"] = item.wall_s
        if isinstance(item, _Last):
            _fill(record, item.observation, item.ground_truth)
            return frame(END, record.tobytes() + item.attributes)
        step = item.step
        record["action_m"] = step.action
        record["action_std"] = np.nan if step.action_std is None else step.action_std
        record["phase"] = step.phase.encode("ascii")
        record[schema.FORCE], record[schema.INTERVENTION] = step.force_n, step.intervention
        record[schema.PULL_NODE] = -1 if step.drag is None else step.drag.node
        record[schema.HAND] = hand_row(step.hand_m)
        record[schema.PULL_TARGET] = np.nan if step.drag is None else step.drag.target_m
        _fill(record, step.observation, known(step.ground_truth))
        return frame(STEP, record.tobytes())

    def _failed(self, error: Exception) -> DataError:
        return WriteError(
            f"{self.ticket.path} cannot be written: {os_reason(error)}; the steps before, and all episodes that were"
            " kept, are safe"
        )


def frame(kind: bytes, content: bytes) -> tuple[bytes, bytes]:
    """Head and content."""
    return FRAME.pack(len(content), zlib.crc32(content, zlib.crc32(kind)), kind), content


def write_all(descriptor: int, *pieces: bytes) -> None:
    """All bytes, or an OSError."""
    for piece in pieces:
        view = memoryview(piece)
        while view:
            view = view[os.write(descriptor, view) :]


def lengths_of(beginning: Episode, *, save_images: bool) -> dict[str, int]:
    """The letters of the schema's shapes, and ``nodes``, in this episode."""
    size = beginning.robot.size
    return _lengths(beginning.final_observation, known(beginning.final_ground_truth), size, save_images=save_images)


def record_dtype(lengths: Mapping[str, int], version: int = schema.SCHEMA_VERSION) -> np.dtype[Any]:
    """One step in bytes, as in this version of the schema (2 or later)."""
    columns: list[tuple[str, str, tuple[int, ...]]] = []
    for field in schema.OBSERVATION_FIELDS:
        if all(isinstance(n, int) or n in lengths for n in field.shape[1:]):
            shape = tuple(n if isinstance(n, int) else lengths[n] for n in field.shape[1:])
            columns.append((field.key, field.dtype, shape))
    columns += [("action_m", "<f8", (lengths["A"],)), ("action_std", "<f8", (lengths["A"],)), ("phase", "|S8", ())]
    if version >= 3:
        columns += [(schema.FORCE, "<f8", (3,)), (schema.PULL_NODE, "<i8", ()), (schema.PULL_TARGET, "<f8", (3,))]
        columns += [(schema.INTERVENTION, "|u1", ()), (schema.HAND, "<f8", (6,))]
    columns += [("nodes", "<f8", (lengths["nodes"], 3))]
    columns += [(key, "<f8", ()) for key in ("contact_portion_true", "flat_area", "wall_s")]
    return np.dtype(columns)


def _lengths(observation: Observation, ground_truth: GroundTruth, actions: int, *, save_images: bool) -> dict[str, int]:
    lengths = {"A": actions, "nodes": len(ground_truth.nodes)}
    if save_images and observation.rgb is not None:
        lengths["H"], lengths["W"] = observation.rgb.shape[:2]
    if save_images and observation.depth is not None:
        lengths["H of depth"], lengths["W of depth"] = observation.depth.shape
    return lengths


def _fill(record: NDArray[Any], observation: Observation, ground_truth: GroundTruth) -> None:
    for key in record.dtype.names or ():
        value = getattr(observation, key, None)
        if value is not None:
            record[key] = np.asarray(value).reshape(record[key].shape)
    record["nodes"] = ground_truth.nodes
    record["contact_portion_true"] = ground_truth.contact_portion_true
    record["flat_area"] = ground_truth.flat_area


def known(ground_truth: GroundTruth | None) -> GroundTruth:
    """Return the ground truth, or raise DataError where there is none."""
    if ground_truth is None:
        raise DataError("an episode without ground truth cannot be kept yet")
    return ground_truth
