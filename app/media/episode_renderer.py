"""Pictures of recorded episodes, rendered from the cloth's nodes where no images were recorded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from layflat.app.media.frames import Frame, caption, frame_strip, video_frame
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.support.errors import UsageError
from layflat.data.camera import CameraModel
from layflat.data.types import Episode, Observation
from layflat.sim.camera.replay_scene import ReplayScene
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.config import recorded_spec
from layflat.sim.errors import SimError

VIDEO_WIDTH, VIDEO_HEIGHT = 640, 480


def check_drawable(episode: Episode) -> None:
    """Raise UsageError for an episode whose cloth is unknown or was not recorded."""
    try:
        spec = recorded_spec(episode.cloth, episode.sim_config)
    except SimError as error:
        raise UsageError(str(error)) from error
    if episode.final_ground_truth is None:
        raise UsageError("the episode has no cloth nodes and cannot be drawn; it does not come from a simulator")
    wanted, shape = (spec.rows * spec.columns, 3), episode.final_ground_truth.nodes.shape
    if shape != wanted:
        raise UsageError(
            f"the recorded cloth has nodes of shape {shape} and cannot be drawn; a {spec.name} has {wanted}"
        )


def is_drawable(episode: Episode) -> bool:
    """Whether check_drawable accepts the episode."""
    try:
        check_drawable(episode)
    except UsageError:
        return False
    return True


class EpisodeRenderer:
    """Draws episodes; keeps one scene for each robot, cloth and camera until it is closed."""

    def __init__(self) -> None:
        self._scenes: dict[tuple[str, ClothSpec, CameraModel | None], ReplayScene] = {}
        self._stack = ExitStack()

    def __enter__(self) -> EpisodeRenderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def frame_strip(self, episode: Episode, step_indices: Sequence[int], width: int) -> tuple[Frame, ...]:
        """Draw moments of ``observations()`` with contact and WORD; none of a cloth that cannot be drawn."""
        if not is_drawable(episode):
            return ()
        seen = list(episode.observations())
        for step_index in set(step_indices):
            seen[step_index] = self._with_images(episode, step_index)
        steps = tuple(
            replace(step, observation=observation) for step, observation in zip(episode.steps, seen, strict=False)
        )
        pictured = replace(episode, steps=steps, final_observation=seen[-1])
        return tuple(frame_strip(pictured, step_indices, PerceptionOverlay(episode.camera), width))

    def camera_frames(self, episode: Episode, width: int = VIDEO_WIDTH) -> Iterator[NDArray[np.uint8]]:
        """Yield every observation with contact tinted and WORD as an arrow, both as recorded."""
        overlay = PerceptionOverlay(episode.camera)
        for step_index in range(len(episode.steps) + 1):
            image = overlay(self._with_images(episode, step_index))
            yield video_frame(image, width, caption(episode, step_index))

    def scene_frames(self, episode: Episode) -> Iterator[NDArray[np.uint8]]:
        """Yield every observation as a person in front of the robot sees the scene."""
        moments = zip(episode.observations(), episode.ground_truths(), strict=True)
        for step_index, (seen, truth) in enumerate(moments):
            image = self._scene(episode).render(truth.nodes, seen.holder_position, VIDEO_WIDTH, VIDEO_HEIGHT)
            contact = min(max(seen.contact_portion, 0.0), 1.0)
            yield video_frame(image, VIDEO_WIDTH, f"{caption(episode, step_index)}  contact {100 * contact:.0f} %")

    def _with_images(self, episode: Episode, step_index: int) -> Observation:
        seen = episode.observations()[step_index]
        if seen.rgb is not None and seen.depth is not None:
            return seen
        nodes = episode.ground_truths()[step_index].nodes
        rgb, depth = self._scene(episode).capture(nodes, seen.holder_position)
        return replace(seen, rgb=rgb, depth=depth)

    def _scene(self, episode: Episode) -> ReplayScene:
        key = episode.robot.name, recorded_spec(episode.cloth, episode.sim_config), episode.camera
        if key not in self._scenes:
            self._scenes[key] = self._stack.enter_context(ReplayScene(*key))
        return self._scenes[key]
