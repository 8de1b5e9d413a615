"""A frame of a session is enough to see the cloth again: with the recorded camera, and by `layflat word`."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from layflat.app.cli import main
from layflat.data import SessionRecorder, open_session
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.pipeline import PerceptionConfig, PerceptionPipeline
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.sim.simulation import ClothSimulation

CELL_M = 0.0025
"""Side of a pixel of the table view."""


@pytest.fixture
def path(tmp_path):
    """A session with images of a wrinkled napkin on the table, three quarters of which rest on it."""
    env = ClothSimulation(SimConfig(robot="pickers", cloth="napkin", task="smooth"))
    episode = rollout(env, PolicySpec.parse("random"), seed=3, max_steps=1, keep_images=True)
    with SessionRecorder(tmp_path / "s.h5", robot=env.spec.robot, cloth="napkin", save_images=True) as recorder:
        recorder.save(episode)
    env.close()
    return tmp_path / "s.h5"


@pytest.mark.timeout(200)
def test_a_recorded_frame_gives_points_and_the_same_contact(path, tmp_path):
    with open_session(path) as session:
        camera, episode = session.camera, session["demo_0"]
        rgb, depth = session.array("demo_0", "obs/rgb")[0], session.array("demo_0", "obs/depth")[0]
    seen, nodes = episode.steps[0].observation, episode.steps[0].ground_truth.nodes
    assert episode.mesh_shape is not None
    assert episode.mesh_shape[0] * episode.mesh_shape[1] == len(nodes)

    # The points of the cloth's pixels are where its nodes are.
    pinhole = PinholeCamera(**vars(camera))
    pixels, _ = pinhole.project(nodes)
    columns, rows = np.round(pixels).astype(int).T
    points = camera.points(depth)[rows, columns]
    assert np.nanmedian(np.linalg.norm(points - nodes, axis=1)) < 0.006

    # With the recorded pose the contact is the same; its unit is that of the flat cloth, which is drawn once.
    state = PerceptionPipeline(pinhole, PerceptionConfig()).perceive(rgb, depth[..., 0])
    flat_pixels = round(state.contact_pixels / seen.contact_portion)
    assert flat_pixels * CELL_M**2 == pytest.approx(0.275 * 0.215, rel=0.05)
    known = PerceptionPipeline(pinhole, PerceptionConfig(), flat_pixels).perceive(rgb, depth[..., 0])
    assert known.contact_portion == pytest.approx(seen.contact_portion, abs=1e-3)

    # Without the pose, from two PNG files.
    cv2.imwrite(str(tmp_path / "rgb.png"), rgb[..., ::-1])
    cv2.imwrite(str(tmp_path / "depth.png"), np.round(depth[..., 0] * 1000).astype(np.uint16))
    lens = ",".join(str(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy))
    frame = [str(tmp_path / "rgb.png"), str(tmp_path / "depth.png"), "--intrinsics", lens]
    with pytest.raises(SystemExit) as stop:
        main.main(["word", *frame, "--flat-pixels", str(flat_pixels), "--json", str(tmp_path / "out.json")])
    assert not stop.value.code
    printed = json.loads((tmp_path / "out.json").read_text())
    assert printed["contact_portion"] == pytest.approx(seen.contact_portion, abs=0.02)
