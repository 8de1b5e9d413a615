"""Episode index: each flag is on the episodes that its definition names, and on no others."""

from dataclasses import replace

import numpy as np
import pytest

from layflat.data import CameraModel, open_session
from layflat.data.format.measures import idle_steps, jerk, outside_share, turned_share
from layflat.data.tools.episode_index import FLAGS, episode_index, flag_counts
from layflat.data.types import ACTION_LIMIT_M, GroundTruth
from tests.factories import make_episode, without_ground_truth, write_session

SHAPE = (7, 9)
CAMERA = CameraModel(
    width=640, height=480, fx=600.0, fy=600.0, cx=319.5, cy=239.5,
    cam_to_world=[[0, -1, 0, 0.2], [-1, 0, 0, 0], [0, 0, -1, 1.0], [0, 0, 0, 1]],
)  # fmt: skip
"""Looks down on (0.2, 0) from 1 m."""


def laid(shift_m=0.0, folded_rows=0):
    """Return a flat cloth of 0.3 m, face up, with its first rows folded over the next ones."""
    x, y = np.meshgrid(np.linspace(0.05, 0.35, SHAPE[0]) + shift_m, np.linspace(0.15, -0.15, SHAPE[1]), indexing="ij")
    nodes = np.stack([x, y, np.full(SHAPE, 0.002)], axis=-1)
    for row in range(folded_rows):
        nodes[row] = nodes[2 * folded_rows - row]
        nodes[row, :, 2] += 0.004
    return nodes


def episode(seed, actions, *, nodes=None, flat_area=0.99, contact=0.98, **changes):
    """Return an episode with these actions, (T, 2) in -1..1, that ends with the cloth as ``nodes``."""
    made = make_episode(n_steps=len(actions), seed=seed, nodes=SHAPE[0] * SHAPE[1])
    steps = [
        replace(step, action=ACTION_LIMIT_M * np.array(action))
        for step, action in zip(made.steps, actions, strict=True)
    ]
    nodes = laid() if nodes is None else nodes
    return replace(
        made,
        steps=steps,
        final_observation=replace(made.final_observation, contact_portion=contact),
        final_ground_truth=GroundTruth(nodes=nodes.reshape(-1, 3), contact_portion_true=contact, flat_area=flat_area),
        camera=CAMERA,
        mesh_shape=SHAPE,
        **changes,
    )


SMOOTH = [[0.5, -0.4]] * 40
STILL = [[0.0, 0.005]] * 21


@pytest.fixture
def session(tmp_path):
    rng = np.random.default_rng(0)
    episodes = [
        episode(0, SMOOTH),
        episode(1, rng.uniform(-1, 1, (40, 2))),
        episode(2, SMOOTH, nodes=laid(folded_rows=1)),
        episode(3, SMOOTH, flat_area=0.7, outcome="failure"),
        episode(4, SMOOTH, nodes=laid(shift_m=0.3)),
        episode(5, STILL + SMOOTH),
        episode(6, SMOOTH + STILL[:20]),
        episode(7, SMOOTH + STILL),
        episode(0, SMOOTH[1:]),
        episode(8, SMOOTH, flat_area=0.96),
        without_ground_truth(episode(9, SMOOTH, contact=0.96)),
        without_ground_truth(episode(10, SMOOTH, contact=0.96, outcome="failure")),
    ]
    # A real robot is another session.
    real = [replace(made, physics="bullet") for made in episodes[-2:]]
    with open_session(write_session(tmp_path / "s.h5", [*episodes[:-2], *real])) as opened:
        yield opened


def test_each_flag(session):
    rows = episode_index(session)
    assert [row.flags for row in rows] == [
        (),
        ("jerky",),
        ("folded",),
        ("folded",),
        ("out of view",),
        ("idle beginning",),
        (),
        ("idle end",),
        ("duplicate seed",),
        ("not flat although success",),
        ("not flat although success",),
        (),
    ]
    assert {flag for row in rows for flag in row.flags} == set(FLAGS)
    assert flag_counts(rows)["folded"] == ("demo_2", "demo_3")
    info = session.info("demo_3")
    assert (rows[3].seed, rows[3].outcome, rows[3].contact, rows[3].flat_area) == (3, "failure", 0.98, 0.7)
    assert rows[3].length_s == pytest.approx(info.n_steps * 0.1)
    assert episode_index(session, ["demo_3"]) == (rows[3],)
    assert episode_index(session) == rows


def test_shares_by_hand():
    """Of six rows of squares one is folded onto the second: the first lies turned over."""
    assert turned_share(laid()) == 0
    assert turned_share(laid()[:, ::-1]) == 1
    assert turned_share(laid(folded_rows=1)) == pytest.approx(1 / 6, abs=0.02)
    assert turned_share(laid()[:, ::-1] + [0, 0, 0.1]) == 0
    corners = np.array([[0.2 + 0.39, 0.52, 0], [0.2 - 0.39, -0.52, 0], [0.2 + 0.41, 0, 0], [0.2, 0.54, 0], [0.2, 0, 2]])
    assert outside_share(corners[:2], CAMERA) == 0
    assert [outside_share(point[None], CAMERA) for point in corners[2:]] == [1, 1, 1]
    assert jerk(np.array([[1.0, 0], [1, 0], [-1, 0]])) == pytest.approx(2 / 3)
    assert (jerk(np.zeros((3, 2))), idle_steps(np.zeros((3, 2)))) == (0, (3, 3))
