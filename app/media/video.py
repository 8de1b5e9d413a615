"""Videos as .webm (VP8), which every browser plays and the OpenCV wheel writes without anything installed."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.support.errors import LayflatError
from layflat.app.support.progress import Progress
from layflat.data.atomic_files import PART_SUFFIX, atomic_path
from layflat.data.names import ascii_folder
from layflat.data.types import Episode

FOURCC = "VP80"
FRAME_S = 0.06
"""Expected wall time of a frame, for the first estimate of the time left."""


def write_video(path: Path, frames: Iterable[NDArray[np.uint8]], *, fps: float = 10.0) -> int:
    """Write (H, W, 3) RGB frames, all of one size, to ``path`` (whole or not at all); return their number.

    The video is read back: a codec that fails silently is an error here, not an empty box in a browser.
    """
    if path.suffix.lower() != ".webm":
        raise LayflatError(f"{path} is not a .webm file; videos are written as .webm", 2)
    with atomic_path(path, path.with_name(f".video.{os.getpid()}{PART_SUFFIX}.webm")) as aside:
        count = _encode(aside, frames, fps)
        with _quiet_stderr():
            readable = count_frames(aside)
        if readable != count:
            with aside.open("ab") as file:  # OpenCV does not say that a disk is full; this does.
                file.write(bytes(1 << 16))
                os.fsync(file.fileno())
            raise LayflatError(f"{path}: {count} frames were written but {readable} can be read back")
    return count


def write_episode_video(path: Path, frames: Iterable[NDArray[np.uint8]], episode: Episode) -> int:
    """Write the frames of an episode, one for each observation, at its own speed, with progress on stderr."""
    count = len(episode.steps) + 1

    def counted() -> Iterator[NDArray[np.uint8]]:
        for frame in frames:
            yield frame
            progress.advance(1 / count)

    with Progress({"video": FRAME_S * count}) as progress:
        progress.phase("video")
        return write_video(path, counted(), fps=1.0 / episode.step_s)


def count_frames(path: Path) -> int:
    """Count the frames of a video that decode."""
    with ascii_folder(path) as name:
        capture = cv2.VideoCapture(name)
    count = 0
    while capture.read()[0]:
        count += 1
    capture.release()
    return count


def _encode(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> int:
    writer = None
    count = 0
    size = (0, 0)
    try:
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                writer = _open(path, fps, size)
            if (frame.shape[1], frame.shape[0]) != size:
                raise LayflatError(f"frame {count} is {frame.shape[1::-1]} pixels; the first one is {size}")
            writer.write(cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2BGR))
            count += 1
    finally:
        if writer is not None:
            writer.release()
    if count == 0:
        raise LayflatError("there are no frames to make a video of; record with images")
    return count


def _open(path: Path, fps: float, size: tuple[int, int]) -> cv2.VideoWriter:
    # Of each frame that has no room on the disk it would print a line.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    with _quiet_stderr(), ascii_folder(path) as name:
        writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*FOURCC), fps, size)
    if not writer.isOpened():
        raise LayflatError("this OpenCV cannot write .webm films; install opencv-python-headless")
    return writer


@contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Keep OpenCV's C code from printing that VP8 is "not supported" by .webm, which it then writes all the same."""
    sys.stderr.flush()
    kept, sink = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)
