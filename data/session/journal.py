"""Journal of a running episode: an append-only file that gives back all but the last second of a killed recording.

``FILE.h5.parts/running-<uid>.journal`` consists of frames, each with the length and the checksum (CRC-32) of its bytes:
first the attributes that are known when an episode starts, then one frame for each step, at last one with the end of
the episode. When a disturbance starts or ends, a frame between two steps lists the disturbances so far. An incomplete
frame ends the journal. The writer holds the file locked.

A thread packs, writes and, twice a second, flushes to the disk; the loop's thread only hands over frozen values. Images
are written as they are: half a megabyte a step for the seconds of an episode, at less than packing them would cost.
When the disk is full, the next step raises an error, and the steps before are safe.
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

from layflat.data.atomic_files import flush, fsync_folder, lock_until_exit, unlock
from layflat.data.errors import DataError, WriteError
from layflat.data.format import schema
from layflat.data.format.encode import attributes_of, check_step, disturbances_json, moment_values, step_values
from layflat.data.robot import RobotSpec
from layflat.data.session.saved_episode import SavedEpisode, save_part
from layflat.data.system_errors import os_reason
from layflat.data.types import DisturbanceRecord, Episode, GroundTruth, Observation, Step

MAGIC = b"LAYFLAT episode journal 1\n"
UNRELEASED_MAGIC = b"LAYFLAT journal 1\n"
FRAME = struct.Struct("<IIc")
"""Number of bytes of content, CRC-32 of kind and content, kind."""
START, STEP, END, DISTURBANCES = b"B", b"T", b"E", b"D"
SYNC_S = 0.5
"""Wall time after which writes are flushed to the disk; with the flush itself well below a second."""
WAITING_MAX = 64
"""Steps that may wait to be written before the loop has to wait: about 32 MB with images, six seconds of a person."""


@dataclass(frozen=True, kw_only=True)
class JournalHandle:
    """Permission to write the journal of one running episode; may be handed to another process."""

    path: Path
    uid: str
    save_images: bool
    name: str
    """Name in the session, ``demo_<int>``, that is reserved for the episode."""
    session: Path
    """The session's file."""

    def save(self, episode: Episode) -> SavedEpisode:
        """Save the finished episode as a part of the session, durable on return, and remove its journal.

        For the process in which the episode ran; its recorder must then `SessionRecorder.register` it.
        """
        saved = save_part(self.session, self.path.parent, self.name, episode, self.uid, save_images=self.save_images)
        self.path.unlink(missing_ok=True)
        return saved

    def open(self, initial: Episode) -> JournalWriter:
        """Start the journal; ``initial`` is the episode without steps, its final observation being the first one."""
        return JournalWriter(self, initial)


class _Last(NamedTuple):
    observation: Observation
    ground_truth: GroundTruth | None
    attributes: bytes


class _Disturbances(NamedTuple):
    text: bytes


_Item: TypeAlias = tuple[Step | _Last | _Disturbances, float]
"""What happened, and the wall time since the start."""


class JournalWriter:
    """Writes the journal of one running episode; its ``on_...`` methods are callbacks of the rollout."""

    def __init__(self, handle: JournalHandle, initial: Episode) -> None:
        self.handle = handle
        self._started = time.monotonic()
        self._robot = initial.robot
        self._lengths = self._lengths_of(initial.final_observation, initial.final_ground_truth)
        self._dtype = record_dtype(self._robot, self._lengths)
        self._problem: DataError | None = None
        self._closed = False
        self._n_steps = 0
        header = {
            "attributes": attributes_of(initial, handle.uid),
            "lengths": self._lengths,
            "joints": initial.initial_joints.tolist(),
        }
        self._open(json.dumps(header).encode("ascii"))
        self._queue: queue.Queue[_Item | None] = queue.Queue(WAITING_MAX)
        self._thread = threading.Thread(target=self._write_queue, name="journal", daemon=True)
        self._thread.start()

    def step(self, step: Step) -> None:
        """Hand over a finished step; DataError where the journal cannot be written or the step does not fit."""
        check_step(step, self._robot)
        self._check_lengths(step.observation, step.ground_truth)
        self._put(step)
        self._n_steps += 1

    def on_step(self, step: Step, step_index: int) -> None:
        """Hand over a finished step, as a callback of the rollout."""
        self.step(step)

    def on_disturbance(self, records: Sequence[DisturbanceRecord]) -> None:
        """Hand over all disturbances so far, counted in the steps that were handed over."""
        self._put(_Disturbances(disturbances_json(records).encode("ascii")))

    def finish(self, episode: Episode) -> None:
        """Write the end: the journal now holds the whole episode. Never raises: saving the episode reports an error."""
        with contextlib.suppress(DataError):
            # The rollout's callbacks are not called for a step that ends in instability.
            for step in episode.steps[self._n_steps :]:
                self.step(step)
            self._check_lengths(episode.final_observation, episode.final_ground_truth)
            attributes = json.dumps(attributes_of(episode, self.handle.uid)).encode("ascii")
            last = _Last(episode.final_observation, episode.final_ground_truth, attributes)
            self._put(last, wall_s=episode.wall_s)
        self.close()

    def close(self) -> None:
        """Wait until everything that was handed over is on the disk, as far as it had room."""
        if self._closed:
            return
        self._closed = True
        self._queue.put(None)
        self._thread.join()
        unlock(self._descriptor)

    def _put(self, item: Step | _Last | _Disturbances, wall_s: float | None = None) -> None:
        if self._problem is not None:
            raise self._problem
        self._queue.put((item, time.monotonic() - self._started if wall_s is None else wall_s))

    def _open(self, header: bytes) -> None:
        path = self.handle.path
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise self._failed(error) from error
        try:
            lock_until_exit(self._descriptor)
            _write_all(self._descriptor, MAGIC, *_frame(START, header))
            flush(self._descriptor)
            fsync_folder(path.parent)
        except OSError as error:
            unlock(self._descriptor)
            path.unlink()
            raise self._failed(error) from error

    def _lengths_of(self, observation: Observation, ground_truth: GroundTruth | None) -> dict[str, int]:
        """Return the letters of the schema's shapes; D is missing without ground truth."""
        lengths = {}
        if ground_truth is not None:
            lengths["D"] = ground_truth.nodes.size
        if self.handle.save_images and observation.rgb is not None:
            lengths["H"], lengths["W"] = observation.rgb.shape[:2]
        if self.handle.save_images and observation.depth is not None:
            lengths["H of depth"], lengths["W of depth"] = observation.depth.shape
        return lengths

    def _check_lengths(self, observation: Observation, ground_truth: GroundTruth | None) -> None:
        lengths = self._lengths_of(observation, ground_truth)
        if lengths != self._lengths:
            raise DataError(f"the sizes of the step are {lengths}; the episode started with {self._lengths}")

    def _write_queue(self) -> None:
        unsynced_since: float | None = None
        while True:
            wait_s = None if unsynced_since is None else max(0.0, unsynced_since + SYNC_S - time.monotonic())
            item: _Item | None = None
            timed_out = False
            try:
                item = self._queue.get(timeout=wait_s)
            except queue.Empty:
                timed_out = True
            ended = item is None and not timed_out
            try:
                if item is not None and self._problem is None:
                    _write_all(self._descriptor, *self._frame_of(*item))
                    unsynced_since = unsynced_since or time.monotonic()
                due = unsynced_since is not None and time.monotonic() >= unsynced_since + SYNC_S
                if unsynced_since is not None and (ended or due):
                    unsynced_since = None
                    flush(self._descriptor)
            except Exception as error:  # Any error must reach the loop, which would otherwise wait for this thread.
                self._problem, unsynced_since = self._failed(error), None
            if ended:
                return

    def _frame_of(self, item: Step | _Last | _Disturbances, wall_s: float) -> tuple[bytes, bytes]:
        if isinstance(item, _Disturbances):
            return _frame(DISTURBANCES, item.text)
        values = moment_values(item.observation, item.ground_truth, save_images=self.handle.save_images)
        if isinstance(item, Step):
            values |= step_values(item, self._robot)
        record = np.zeros((), self._dtype)
        record["wall_s"] = wall_s
        for key, value in values.items():
            record[key] = value
        if isinstance(item, _Last):
            return _frame(END, record.tobytes() + item.attributes)
        return _frame(STEP, record.tobytes())

    def _failed(self, error: Exception) -> DataError:
        return WriteError(
            f"{self.handle.path} cannot be written: {os_reason(error)}; earlier steps and saved episodes are safe"
        )


def record_dtype(robot: RobotSpec, lengths: Mapping[str, int]) -> np.dtype[Any]:
    """Return the form of one moment and the step after it, by key of the schema."""
    columns: list[tuple[str, str, tuple[int, ...]]] = [("wall_s", "<f8", ())]
    for field in (*schema.OBSERVATION_FIELDS, *schema.STEP_FIELDS):
        shape = schema.row_shape(field, robot, lengths)
        if shape is not None:
            columns.append((field.key, field.dtype, shape))
    if "D" in lengths:
        columns.append((schema.STATES, "<f8", (lengths["D"],)))
        columns += [(key, "<f8", (1,)) for key in (schema.CONTACT_TRUE, schema.FLAT_AREA)]
    return np.dtype(columns)


def _frame(kind: bytes, content: bytes) -> tuple[bytes, bytes]:
    """Return head and content of a frame."""
    return FRAME.pack(len(content), zlib.crc32(content, zlib.crc32(kind)), kind), content


def _write_all(descriptor: int, *pieces: bytes) -> None:
    """Write all bytes, or raise an OSError."""
    for piece in pieces:
        view = memoryview(piece)
        while view:
            view = view[os.write(descriptor, view) :]
