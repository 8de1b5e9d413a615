"""Thumbnails: the kept image, or the cloth drawn from its nodes with face and reverse in two colors."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from layflat.app.media.cloth_colors import REVERSE, TABLE
from layflat.app.media.thumbnails import thumbnail
from layflat.data import GroundTruth, open_session
from layflat.sim.cloth.registry import cloth_spec
from tests.factories import make_episode, without_ground_truth, write_session

SPEC = cloth_spec("napkin")
SHAPE = (SPEC.rows, SPEC.columns)


def picture(path, name="demo_0", **options):
    with open_session(path) as session:
        return cv2.cvtColor(
            cv2.imdecode(np.frombuffer(thumbnail(session, name, **options), np.uint8), 1), cv2.COLOR_BGR2RGB
        )


def near(image, color, reach=40):
    """Return the share of pixels of about this color."""
    return float((np.abs(image.astype(int) - np.array(color)).max(axis=2) < reach).mean())


@pytest.mark.parametrize("lifted_m", [0.0, 0.1])
def test_face_reverse_and_table_without_a_camera(tmp_path, lifted_m):
    flat = SPEC.flat_nodes(x_m=0.2) + np.array([0, 0, lifted_m])
    turned = flat.reshape(*SHAPE, 3)[::-1].reshape(-1, 3)
    made = make_episode(nodes=len(flat), cloth="napkin", mesh_shape=SHAPE)
    ends = [replace(made.final_ground_truth, nodes=nodes) for nodes in (flat, turned)]
    path = write_session(
        tmp_path / "s.h5", [replace(made, seed=k, final_ground_truth=end) for k, end in enumerate(ends)]
    )
    face, reverse = picture(path), picture(path, "demo_1")
    assert face.shape == (120, 160, 3)
    orange = REVERSE if lifted_m else (111, 87, 32)
    assert near(face, orange) < 0.01
    assert near(reverse, orange) > 0.1
    assert 0.3 < near(face, TABLE, 10) < 0.9


def test_a_kept_image_is_shown_and_an_unknown_end_is_plain(tmp_path):
    kept = make_episode(images=True)
    path = write_session(tmp_path / "s.h5", [kept])
    shown = picture(path, width=8)
    assert np.array_equal(shown, kept.final_observation.rgb)
    real = write_session(tmp_path / "r.h5", [without_ground_truth(make_episode())])
    assert near(picture(real), TABLE, 2) == 1


def test_it_shows_the_end_of_a_trim(tmp_path):
    made = make_episode(nodes=SPEC.rows * SPEC.columns, cloth="napkin", mesh_shape=SHAPE, n_steps=4)
    flat = GroundTruth(nodes=SPEC.flat_nodes(), contact_portion_true=1, flat_area=1)
    steps = [*made.steps[:2], replace(made.steps[2], ground_truth=flat), made.steps[3]]
    path = write_session(tmp_path / "s.h5", [replace(made, steps=steps), replace(made, final_ground_truth=flat)])
    with open_session(path) as session:
        session.preview_trim("demo_0", 0, 2)
        assert thumbnail(session, "demo_0") == thumbnail(session, "demo_1")
