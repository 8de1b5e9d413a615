"""A recorded episode as moments of the bench, without a simulator: nodes as they were, and what a camera would see."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from layflat.app.media.episode_renderer import check_drawable
from layflat.app.support.errors import UsageError
from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.window.time_series import TimeSeries
from layflat.data.arrays import FloatArray
from layflat.data.types import Episode, Observation
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.descriptors.registry import make_descriptor
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.camera.renderer import Renderer
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import robot_type

MOMENTS_KEPT = 64


class Playback:
    """Moments of one episode by number: 0 before its first step, ``last`` after its last."""

    def __init__(self, name: str, episode: Episode) -> None:
        """UsageError where the recorded cloth is none that can be drawn."""
        check_drawable(episode)
        self.name = name
        self.episode = episode
        self.last = len(episode.steps)
        self.number = hash((name, episode.seed, self.last, episode.provenance.created_utc)) % 2**31
        self.history = TimeSeries.of(episode, self.number)
        self._seen, self._truths = episode.observations(), episode.ground_truths()
        self._meshes = MeshMaker(cloth_spec(episode.cloth))
        pinhole = default_pinhole()
        self._perceiver = PerceptionPipeline(pinhole, PerceptionConfig(descriptor=make_descriptor(episode.descriptor)))
        self._view = Renderer(pinhole)
        self._shape = (pinhole.height, pinhole.width)
        self._made = lru_cache(maxsize=MOMENTS_KEPT)(self._make)

    def moment(self, number: int) -> BenchFrame:
        return self._made(min(max(number, 0), self.last))

    def befalls(self, number: int) -> str:
        """What disturbs the cloth in this step, and whether a person leads; empty where neither is so."""
        if number >= self.last:
            return ""
        names = [
            record.name
            for record in self.episode.disturbances
            if record.first_step <= number and (record.last_step is None or number <= record.last_step)
        ]
        step = self.episode.steps[number]
        by_hand = ["pulled by hand"] if step.drag is not None else []
        return ", ".join([*names, *by_hand, *(["a person leads"] if step.intervention else [])])

    def _make(self, number: int) -> BenchFrame:
        seen, ground_truth = self._seen[number], self._truths[number]
        # What acted in the step that led here.
        step = self.episode.steps[number - 1] if number else None
        rgb, cloth_state = self._sight(seen, ground_truth.nodes)
        return BenchFrame(
            episode=self.number,
            step=number,
            phase=self.history.phase[number],
            sim_s=seen.time_s,
            told_s=0.0,
            input_s=0.0,
            work_s=0.0,
            robot=self.episode.robot.name,
            cloth=self.episode.cloth,
            nodes=ground_truth.nodes,
            corners=seen.corner_positions,
            holder=seen.holder_position,
            joints=self._joints(seen),
            hands=np.zeros((0, 3)),
            force_n=np.zeros(3) if step is None else step.force_n,
            pull=None if step is None or step.drag is None else (step.drag.node, step.drag.target_m),
            word=seen.word,
            strength=seen.word_strength,
            contact=seen.contact_portion,
            contact_true=ground_truth.contact_portion_true,
            flat_area=ground_truth.flat_area,
            rgb=rgb,
            cloth_state=cloth_state,
            led=self.history.led[number],
        )

    def _joints(self, seen: Observation) -> FloatArray:
        """The arm's, hand straight down, where the robot has one."""
        try:
            return robot_type(self.episode.robot.name).joint_angles_at(seen.holder_position)
        except SimError:
            return np.zeros(0)  # A place that no arm reaches was imported from elsewhere.

    def _sight(self, seen: Observation, nodes: FloatArray) -> tuple[NDArray[np.uint8], ClothState]:
        """The recorded images, or the cloth alone as the camera would see it; with the recorded contact and WORD."""
        if seen.rgb is not None and seen.depth is not None and seen.rgb.shape[:2] == self._shape:
            rgb, depth = seen.rgb, seen.depth
        else:
            picture = self._view.background()
            self._view.draw_cloth(picture, self._meshes.mesh(nodes))
            rgb = picture.rgb.reshape(*self._shape, 3)
            depth = np.where(np.isfinite(picture.depth), picture.depth, np.float32(0)).reshape(self._shape)
        found = self._perceiver.perceive(rgb, depth)
        return rgb, replace(found, contact_portion=seen.contact_portion, word=seen.word, strength=seen.word_strength)


def facts(episode: Episode) -> Mapping[str, str]:
    """What a person is told of it."""
    contact = episode.contact()
    befell = [record.name for record in episode.disturbances]
    pulls = sum(step.drag is not None for step in episode.steps)
    led = sum(step.intervention for step in episode.steps)
    corrected = {"corrected": f"a person led in {led} steps"} if led else {}
    return {
        "source": f"{episode.source}, seed {episode.seed}",
        "bench": f"{episode.robot}, {episode.cloth}, step {episode.step_s:g} s",
        "outcome": f"{episode.outcome}, {episode.stopped_by.replace('_', ' ')}",
        "steps": str(len(episode.steps)),
        "contact": f"{100 * contact[0]:.0f} to {100 * contact[-1]:.0f} %",
        "disturbed by": ", ".join([*befell, *([f"pulls in {pulls} steps"] if pulls else [])]) or "nothing",
        **corrected,
        "recorded": episode.provenance.created_utc.replace("T", " ")[:16] or "not told",
    }


def checked_playback(name: str, episode: Episode) -> Playback | str:
    """The playback, or why there is none."""
    try:
        return Playback(name, episode)
    except (UsageError, SimError) as error:
        return str(error)
