"""Frames of an episode, for strips as in the thesis's Figures 4-2 to 4-5 and for videos."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.support.phases import disturbed_spans, phase_spans, placed_step
from layflat.data.types import Episode, Observation

Draw = Callable[[Observation], NDArray[np.uint8]]
"""Draws an observation for a person; (H, W, 3) uint8 RGB."""

STRIP_FRAMES = 10
REPAIR_FRAMES = 5
PHASE_LABELS = {"place": "placing", "disturb": "disturbance", "repair": "repair"}


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One picture of a strip."""

    step: int
    image: NDArray[np.uint8]
    label: str
    """State of the episode: "placing", "stopped", "disturbance", ..."""
    contact: float
    time_s: float


def placing_steps(episode: Episode) -> list[int]:
    """Return ten moments from the start to the end of the place phase."""
    end = placed_step(episode)
    return _spread(0, end if end is not None else len(episode.steps), STRIP_FRAMES)


def disturbance_steps(episode: Episode) -> list[int]:
    """Return ten moments: three of placing, two of the last disturbance, five of the repair; none without any."""
    spans = disturbed_spans(episode)
    if not spans:
        return []
    first, end = spans[-1]
    before = _spread(0, first, 3)
    return [*before, (first + end + 1) // 2, end, *_spread(end, len(episode.steps), REPAIR_FRAMES + 1)[1:]]


def key_steps(episode: Episode, count: int) -> list[int]:
    """Return ``count`` moments: the start, the end of every phase span, and the middles of the longest gaps.

    An episode with more spans than that shows its last ones.
    """
    ends = [0, *(span.end for span in phase_spans(episode))]
    while len(ends) < count:
        gaps = np.diff(ends)
        if not len(gaps) or gaps.max() < 2:
            break
        widest = int(gaps.argmax())
        ends.insert(widest + 1, ends[widest] + int(gaps[widest]) // 2)
    return ends if len(ends) <= count else [ends[0], *ends[1 - count :]]


def frame_strip(episode: Episode, step_indices: Sequence[int], draw: Draw, width: int) -> list[Frame]:
    """Draw the frames with an image that are nearest to the given steps; empty where no observation has an image."""
    observations = episode.observations()
    pictured = np.array([step_index for step_index, o in enumerate(observations) if o.rgb is not None])
    if not len(pictured):
        return []
    found = [int(pictured[np.abs(pictured - step_index).argmin()]) for step_index in step_indices]
    return [
        Frame(
            step=step_index,
            image=_resized(draw(observations[step_index]), width),
            label=frame_label(episode, step_index),
            contact=min(observations[step_index].contact_portion, 1.0),
            time_s=step_index * episode.step_s,
        )
        for step_index in found
    ]


def frame_label(episode: Episode, step_index: int) -> str:
    """Return one or two words on the state of the episode at a moment."""
    if step_index == 0:
        return "start"
    if step_index == placed_step(episode):
        return "stopped"
    if step_index >= len(episode.steps):
        return "end"
    if any(step_index == end for _, end in disturbed_spans(episode)):
        return "disturbed"
    return PHASE_LABELS[episode.steps[step_index].phase]


def active_disturbances(episode: Episode, step_index: int) -> str:
    """Say what acts on the cloth in a step, and who decides: "wind 0.40 N", "a hand 0.12 N, a person decides"."""
    if step_index >= len(episode.steps):
        return ""
    step = episode.steps[step_index]
    spans = zip(episode.disturbances, disturbed_spans(episode), strict=False)
    names = [record.name for record, (first, end) in spans if first <= step_index < end]
    names += ["a hand"] if step.drag is not None else []
    force = float(np.linalg.norm(step.force_n))
    acting = " and ".join(names) + (f" {force:.2f} N" if names and force else "")
    guided = "guided by hand" if step.hand_m is not None else ""
    return ", ".join(filter(None, (acting, guided, "a person decides" if step.intervention else "")))


def caption(episode: Episode, step_index: int) -> str:
    """Return the label of a moment and what acts on the cloth."""
    return "  ".join(filter(None, (frame_label(episode, step_index), active_disturbances(episode, step_index))))


def video_frames(episode: Episode, draw: Draw, width: int) -> Iterator[NDArray[np.uint8]]:
    """Yield every observation that has an image, ``width`` pixels wide, with its caption."""
    for step_index, observation in enumerate(episode.observations()):
        if observation.rgb is not None:
            yield video_frame(draw(observation), width, caption(episode, step_index))


def video_frame(image: NDArray[np.uint8], width: int, text: str) -> NDArray[np.uint8]:
    """Scale an image to a video's width and write a text into its corner."""
    return _titled(_resized(image, width), text)


def contact_sheet(rows: Sequence[Sequence[Frame]]) -> NDArray[np.uint8]:
    """Join strips of equal length into one image, a row each, with label and contact on every frame."""
    if not rows or not rows[0] or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError("a contact sheet needs at least one strip, all of one length and not empty")
    return np.asarray(np.vstack([np.hstack([_bordered(frame) for frame in row]) for row in rows]), dtype=np.uint8)


def _bordered(frame: Frame) -> NDArray[np.uint8]:
    titled = _titled(frame.image, f"{frame.label} {100 * frame.contact:.0f} %")
    return np.pad(titled, ((0, 4), (0, 4), (0, 0)), constant_values=255)


def _spread(first: int, last: int, count: int) -> list[int]:
    return [int(step_index) for step_index in np.linspace(first, last, count).round()]


def _resized(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Scale to ``width``; both sides become even, as VP8 needs."""
    height = 2 * round(image.shape[0] * width / image.shape[1] / 2)
    interpolation = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (width, height), interpolation=interpolation), dtype=np.uint8)


def _titled(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    canvas = image.copy()
    size = max(image.shape[1] / 800, 0.45)
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    box = canvas[: height + 14, : width + 18]
    box[:] = (0.35 * box + 0.65 * np.array([24, 28, 36])).astype(np.uint8)
    cv2.putText(canvas, text, (9, height + 7), cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas
