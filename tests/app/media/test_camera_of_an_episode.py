"""Pictures of an episode are those of its own camera, wherever that stood and however many pixels it had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import layflat
from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.media.perception_overlay import SCALE, PerceptionOverlay
from layflat.app.workstation.playback import Playback
from layflat.data.types import Episode


@pytest.fixture(scope="module")
def episode() -> Episode:
    """Two steps before a camera of another size that stands elsewhere."""
    settings = {"camera_width_px": 240, "camera_x_m": 0.12, "camera_tilt_deg": -4.0, "depth_noise": 0.0}
    env = layflat.make_env("pickers", cloth="napkin", start="hanging-quick", **settings)
    policy = layflat.load_policy("hold")
    made = layflat.rollout(env, policy, seed=1, max_steps=2, keep_images=True)
    env.close()
    return made


def test_an_overlay_has_the_size_of_the_recorded_image(episode: Episode) -> None:
    image = PerceptionOverlay(episode.camera)(episode.steps[0].observation)
    assert image.shape == (SCALE * 180, SCALE * 240, 3)


def test_what_is_drawn_again_is_what_the_camera_saw(episode: Episode) -> None:
    seen = episode.final_observation
    bare = replace(
        episode,
        steps=tuple(
            replace(step, observation=replace(step.observation, rgb=None, depth=None)) for step in episode.steps
        ),
        final_observation=replace(seen, rgb=None, depth=None),
    )
    playback = Playback("again", bare)
    again = playback.frame(playback.last)
    assert again.rgb is not None
    assert seen.rgb is not None
    assert again.rgb.shape == seen.rgb.shape
    assert np.mean(np.abs(again.rgb.astype(int) - seen.rgb)) < 1.0
    assert again.pinhole.position == pytest.approx(np.array(episode.camera.cam_to_world)[:3, 3])  # type: ignore[union-attr]
    with EpisodeRenderer() as renderer:
        (frame,) = renderer.frame_strip(bare, [2], 240)
        (recorded,) = renderer.frame_strip(episode, [2], 240)
    assert np.mean(np.abs(frame.image.astype(int) - recorded.image)) < 4.0
