"""Playback: a recorded episode as frames, without a simulator; nodes as recorded, and what a camera would see."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from layflat.app.media.episode_renderer import check_drawable
from layflat.app.support.errors import UsageError
from layflat.app.workstation.preview import arm_joints
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.time_series import TimeSeries
from layflat.data.arrays import FloatArray
from layflat.data.types import Episode, Observation
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.descriptors.registry import make_descriptor
from layflat.sim.camera.camera import recorded_pinhole
from layflat.sim.camera.renderer import Renderer
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.config import recorded_spec
from layflat.sim.errors import SimError

MAX_FRAMES = 64
"""Number of frames that are kept once they are made."""


class Playback:
    """Frames of one episode by number: 0 before its first step, ``last`` after its last."""

    def __init__(self, name: str, episode: Episode) -> None:
        """UsageError where the recorded cloth cannot be drawn."""
        check_drawable(episode)
        self.name = name
        self.episode = episode
        self.last = len(episode.steps)
        self.number = hash((name, episode.seed, self.last, episode.provenance.created_utc)) % 2**31
        self.series = TimeSeries.of(episode, self.number)
        self._observations, self._truths = episode.observations(), episode.ground_truths()
        self._cloth = recorded_spec(episode.cloth, episode.sim_config)
        self._meshes = MeshMaker(self._cloth)
        pinhole = self._pinhole = recorded_pinhole(episode.camera, self._cloth)
        self._perception = PerceptionPipeline(pinhole, PerceptionConfig(descriptor=make_descriptor(episode.descriptor)))
        self._renderer = Renderer(pinhole)
        self._shape = (pinhole.height, pinhole.width)
        self._cached = lru_cache(maxsize=MAX_FRAMES)(self._make_frame)

    def frame(self, number: int) -> SimulationFrame:
        """Return a frame; numbers outside the episode mean its ends."""
        return self._cached(min(max(number, 0), self.last))

    def active_disturbances(self, number: int) -> str:
        """Return what disturbs the cloth in a step, and whether a person is in control."""
        if number >= self.last:
            return ""
        names = [
            record.name
            for record in self.episode.disturbances
            if record.first_step <= number and (record.last_step is None or number <= record.last_step)
        ]
        step = self.episode.steps[number]
        dragged = ["dragged by a person"] if step.drag is not None else []
        return ", ".join([*names, *dragged, *(["a person is in control"] if step.intervention else [])])

    def _make_frame(self, number: int) -> SimulationFrame:
        episode, seen, truth = self.episode, self._observations[number], self._truths[number]
        # The step that ended with this frame.
        step = episode.steps[number - 1] if number else None
        nodes = np.zeros((0, 3)) if truth is None else truth.nodes
        rgb, state = self._camera_image(seen, nodes)
        return SimulationFrame(
            episode=self.number,
            step=number,
            phase=self.series.phase[number],
            sim_s=seen.time_s,
            robot=episode.robot.name,
            cloth=episode.cloth,
            nodes=nodes,
            corners=seen.corner_positions,
            holder=seen.holder_position,
            joints=arm_joints(episode.robot.name, seen.holder_position, self._cloth),
            force_n=np.zeros(3) if step is None else step.force_n,
            drag=None if step is None else step.drag,
            word=seen.word,
            word_strength=seen.word_strength,
            contact=seen.contact_portion,
            contact_true=0.0 if truth is None else truth.contact_portion_true,
            flat_area=0.0 if truth is None else truth.flat_area,
            rgb=rgb,
            cloth_state=state,
            pinhole=self._pinhole,
            human_in_control=self.series.human[number],
        )

    def _camera_image(self, seen: Observation, nodes: FloatArray) -> tuple[NDArray[np.uint8], ClothState]:
        """Return the recorded image, or the cloth as the camera would see it; with the recorded contact and WORD."""
        if seen.rgb is not None and seen.depth is not None and seen.rgb.shape[:2] == self._shape:
            rgb, depth = seen.rgb, seen.depth
        else:
            picture = self._renderer.background()
            self._renderer.draw_cloth(picture, self._meshes.mesh(nodes))
            rgb = picture.rgb.reshape(*self._shape, 3)
            depth = np.where(np.isfinite(picture.depth), picture.depth, np.float32(0)).reshape(self._shape)
        state = self._perception.perceive(rgb, depth)
        return rgb, replace(state, contact_portion=seen.contact_portion, word=seen.word, strength=seen.word_strength)


def episode_facts(episode: Episode) -> Mapping[str, str]:
    """Return facts about an episode, for a person."""
    contact = episode.contact()
    n_drags = sum(step.drag is not None for step in episode.steps)
    n_human = sum(step.intervention for step in episode.steps)
    disturbances = [record.name for record in episode.disturbances]
    disturbances += [f"drags in {n_drags} steps"] if n_drags else []
    return {
        "source": f"{episode.source}, seed {episode.seed}",
        "simulation": f"{episode.robot}, {episode.cloth}, step {episode.step_s:g} s",
        "outcome": f"{episode.outcome}, {episode.stopped_by.replace('_', ' ')}",
        "steps": str(len(episode.steps)),
        "contact": f"{100 * contact[0]:.0f} to {100 * contact[-1]:.0f} %",
        "disturbances": ", ".join(disturbances) or "none",
        **({"interventions": f"a person in control in {n_human} steps"} if n_human else {}),
        "recorded": episode.provenance.created_utc.replace("T", " ")[:16] or "unknown",
    }


def open_playback(name: str, episode: Episode) -> Playback | str:
    """Return the playback, or why there is none."""
    try:
        return Playback(name, episode)
    except (UsageError, SimError) as error:
        return str(error)
