"""The arm's shape without a simulator: where Bullet has its links."""

from __future__ import annotations

import numpy as np
import pybullet as bullet
import pytest

from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.errors import SimError
from layflat.sim.robots.hanger import PandaHanger
from layflat.sim.robots.panda import CLIP_DROP_M, JOINTS, inverse_kinematics
from layflat.tests.sim.robots.hangers import JOINT_HIGH_RAD, JOINT_LOW_RAD


@pytest.fixture(scope="module")
def shape():
    return PandaHanger.arm_shape(cloth_spec("towel"))


def test_links_are_where_bullet_has_them(shape, world):
    arm = PandaHanger.add_arm(world, cloth_spec("towel"))
    for seed in range(5):
        angles = np.random.default_rng(seed).uniform(JOINT_LOW_RAD, JOINT_HIGH_RAD)
        arm.reset_joints(angles)
        for joint, frame in enumerate(shape.link_frames(angles)[1:]):
            state = bullet.getLinkState(arm.body, joint, computeForwardKinematics=True, physicsClientId=world.client)
            turn = np.array(bullet.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            np.testing.assert_allclose(frame[:3, 3], state[4], atol=1e-6)
            np.testing.assert_allclose(frame[:3, :3], turn, atol=1e-6)


def test_the_clips_end_at_the_corners_of_the_cloth(shape):
    centre = np.array([0.2, 0.0, 0.1])
    placed = shape.placed(inverse_kinematics(centre))
    hanger = placed[np.unique(shape.triangles[shape.is_hanger])]
    assert hanger[:, 2].min() == pytest.approx(centre[2], abs=1e-6)
    assert hanger[:, 2].max() == pytest.approx(centre[2] + CLIP_DROP_M + 0.004, abs=1e-6)
    assert np.abs(hanger.mean(axis=0)[:2] - centre[:2]).max() < 1e-6


def test_triangles_face_outwards(shape):
    """Of a closed surface the areas' normals add up to nothing, and its volume is positive if they look outwards."""
    a, b, c = (shape.vertices[shape.triangles[:, k]] for k in range(3))
    volume = np.einsum("tk,tk->t", a, np.cross(b, c)) / 6
    for link in range(JOINTS + 1):
        own = shape.link[shape.triangles[:, 0]] == link
        assert volume[own].sum() > 0


def test_a_wrong_number_of_joints_is_refused(shape):
    with pytest.raises(SimError, match="7 joints"):
        shape.placed(np.zeros(6))
