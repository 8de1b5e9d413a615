"""Frames of an episode, for strips as in the thesis's Figures 4-2 to 4-5 and for films."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.support.metrics import disturbed_spans, placed_step
from layflat.data.types import Episode, Observation

Draw = Callable[[Observation], NDArray[np.uint8]]
"""Makes the picture of an observation for a person; (H, W, 3) uint8 RGB."""

STRIP_FRAMES = 10
REPAIR_FRAMES = 5
PHASE_WORDS = {"place": "placing", "disturb": "disturbance", "repair": "repair"}


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One picture of a strip."""

    step: int
    image: NDArray[np.uint8]
    word: str
    """What is going on: "placing", "stopped", "disturbance", ..."""
    contact: float
    time_s: float


def draw_plain(observation: Observation) -> NDArray[np.uint8]:
    """The camera's picture as it is."""
    if observation.rgb is None:
        raise ValueError("the observation has no image; draw only those that have one")
    return observation.rgb


def placing_steps(episode: Episode) -> list[int]:
    """Ten moments from the start to the end of the place phase."""
    end = placed_step(episode)
    return _spread(0, end if end is not None else len(episode.steps), STRIP_FRAMES)


def disturbance_steps(episode: Episode) -> list[int]:
    """Ten moments: start, middle and stop of placing, twice in the (last) disturbance, then the repair to its end."""
    spans = disturbed_spans(episode)
    if not spans:
        return []
    begin, over = spans[-1]
    before = _spread(0, begin, 3)
    return [*before, (begin + over + 1) // 2, over, *_spread(over, len(episode.steps), REPAIR_FRAMES + 1)[1:]]


def frame_strip(episode: Episode, step_indices: Sequence[int], draw: Draw, width: int) -> list[Frame]:
    """The frames at (or nearest to) ``steps`` that have an image, ``width`` pixels wide; empty where none has one."""
    observations = episode.observations()
    pictured = np.array([step_index for step_index, o in enumerate(observations) if o.rgb is not None])
    if not len(pictured):
        return []
    found = [int(pictured[np.abs(pictured - step_index).argmin()]) for step_index in step_indices]
    return [
        Frame(
            step=step_index,
            image=_resized(draw(observations[step_index]), width),
            word=frame_label(episode, step_index),
            contact=min(observations[step_index].contact_portion, 1.0),
            time_s=step_index * episode.step_s,
        )
        for step_index in found
    ]


def frame_label(episode: Episode, step_index: int) -> str:
    """One or two words on what goes on at a moment."""
    if step_index == 0:
        return "start"
    if step_index == placed_step(episode):
        return "stopped"
    if step_index >= len(episode.steps):
        return "end"
    if any(step_index == over for _, over in disturbed_spans(episode)):
        return "disturbed"
    return PHASE_WORDS[episode.steps[step_index].phase]


def active_disturbances(episode: Episode, step_index: int) -> str:
    """What acts on the cloth in a step, and who decides: "wind 0.40 N", "a hand 0.12 N, a person decides", or ""."""
    if step_index >= len(episode.steps):
        return ""
    step = episode.steps[step_index]
    spans = disturbed_spans(episode)
    acting = [
        r.name for r, (begun, over) in zip(episode.disturbances, spans, strict=False) if begun <= step_index < over
    ]
    names = [*acting, *(["a hand"] if step.pull is not None else [])]
    force = float(np.linalg.norm(step.force_n))
    told = " and ".join(names) + (f" {force:.2f} N" if names and force else "")
    led = ["guided by hand"] if step.hand_m is not None else []
    return ", ".join(filter(None, (told, *led, "a person decides" if step.intervention else "")))


def video_frames(episode: Episode, draw: Draw, width: int) -> Iterator[NDArray[np.uint8]]:
    """Every observation with an image, ``width`` pixels wide, with the phase written on it."""
    for step_index, observation in enumerate(episode.observations()):
        if observation.rgb is not None:
            yield video_frame(draw(observation), width, caption(episode, step_index))


def caption(episode: Episode, step_index: int) -> str:
    """What goes on at a moment, and what befalls the cloth."""
    return "  ".join(filter(None, (frame_label(episode, step_index), active_disturbances(episode, step_index))))


def video_frame(image: NDArray[np.uint8], width: int, text: str) -> NDArray[np.uint8]:
    """The picture ``width`` pixels wide, as a film wants it, with a text in its corner."""
    return _titled(_resized(image, width), text)


def has_images(episode: Episode) -> bool:
    """Whether at least one observation has an image."""
    return any(observation.rgb is not None for observation in episode.observations())


def contact_sheet(rows: Sequence[Sequence[Frame]]) -> NDArray[np.uint8]:
    """One picture of several strips of equal length, a row each, with moment and contact written on every frame."""
    if not rows or not rows[0] or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError("a sheet needs at least one strip, all of one length and not empty")
    lines = [np.hstack([_bordered(_titled(f.image, f"{f.word} {100 * f.contact:.0f} %")) for f in row]) for row in rows]
    return np.asarray(np.vstack(lines), dtype=np.uint8)


def _bordered(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.pad(image, ((0, 4), (0, 4), (0, 0)), constant_values=255)


def _spread(first: int, last: int, count: int) -> list[int]:
    return [int(step_index) for step_index in np.linspace(first, last, count).round()]


def _resized(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Scaled to ``width``, both sides even (as VP8 wants)."""
    height = 2 * round(image.shape[0] * width / image.shape[1] / 2)
    way = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (width, height), interpolation=way), dtype=np.uint8)


def _titled(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    canvas = image.copy()
    size = max(image.shape[1] / 800, 0.45)
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    box = canvas[: height + 14, : width + 18]
    box[:] = (0.35 * box + 0.65 * np.array([24, 28, 36])).astype(np.uint8)
    cv2.putText(canvas, text, (9, height + 7), cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas
