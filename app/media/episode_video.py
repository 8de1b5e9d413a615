"""Frames of a recorded episode, with or without the images that were recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from layflat.app.media.frames import caption, video_frame
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.media.video import write_video
from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.support.progress import Progress
from layflat.data.types import Episode
from layflat.sim.camera.replay_scene import ReplayScene
from layflat.sim.cloth.cloth import CLOTHS, cloth_spec

WIDTH, HEIGHT = 640, 480
FRAME_S = 0.06
"""Expected wall time of a frame, for the first estimate of the time left."""


def check_drawable(episode: Episode) -> None:
    """UsageError where the recorded cloth is none that can be drawn."""
    validators.one_of("cloth", episode.cloth, CLOTHS)
    spec = cloth_spec(episode.cloth)
    if episode.final_ground_truth is None:
        raise UsageError("the episode has no cloth nodes and cannot be drawn; it does not come from a simulator")
    wanted, shape = (spec.rows * spec.columns, 3), episode.final_ground_truth.nodes.shape
    if shape != wanted:
        raise UsageError(
            f"the recorded cloth has nodes of shape {shape} and cannot be drawn; a {spec.name} has {wanted}"
        )


def write_episode_video(path: Path, frames: Iterable[NDArray[np.uint8]], episode: Episode) -> int:
    """Write the frames of an episode, one for each observation, at its own speed; returns how many they are."""
    count = len(episode.steps) + 1

    def told() -> Iterator[NDArray[np.uint8]]:
        for frame in frames:
            yield frame
            progress.advance(1 / count)

    with Progress({"film": FRAME_S * count}) as progress:
        progress.phase("film")
        return write_video(path, told(), fps=1.0 / episode.step_s)


def scene_frames(episode: Episode) -> Iterator[NDArray[np.uint8]]:
    """What was, as a person in front of the robot saw it; drawn from the nodes, one frame for each observation."""
    with ReplayScene(episode.robot.name, episode.cloth) as stage:
        for step_index, (seen, ground_truth) in enumerate(
            zip(episode.observations(), episode.ground_truths(), strict=True)
        ):
            image = stage.render(ground_truth.nodes, seen.holder_position, WIDTH, HEIGHT)
            contact = min(max(seen.contact_portion, 0.0), 1.0)
            yield video_frame(image, WIDTH, f"{caption(episode, step_index)}  contact {100 * contact:.0f} %")


def camera_frames(episode: Episode) -> Iterator[NDArray[np.uint8]]:
    """What the camera saw and what perception made of it: contact tinted, WORD as an arrow, one frame each.

    Where no images were recorded, they are drawn from the nodes; the contact portion shown is the recorded one.
    """
    drawer = PerceptionOverlay()
    with ExitStack() as stack:
        stage: ReplayScene | None = None
        for step_index, (seen, ground_truth) in enumerate(
            zip(episode.observations(), episode.ground_truths(), strict=True)
        ):
            if seen.rgb is None or seen.depth is None:
                stage = stage or stack.enter_context(ReplayScene(episode.robot.name, episode.cloth))
                rgb, depth = stage.capture(ground_truth.nodes, seen.holder_position)
                seen = replace(seen, rgb=rgb, depth=depth)
            yield video_frame(drawer(seen), WIDTH, caption(episode, step_index))
