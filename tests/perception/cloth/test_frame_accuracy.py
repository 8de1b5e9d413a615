"""The numbers of docs/explanation/results/camera.md: `pytest -m slow -s -k frame_accuracy` prints them."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
import pytest

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.table_plane import TablePlane, fit_table_plane
from layflat.perception.cloth.analyze_frame import FrameResult, analyze_frame
from layflat.perception.cloth.color_calibration import learn_hsv
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.errors import PerceptionError
from layflat.tests.perception.factories import axis_error
from layflat.tests.scenes import CLOTHS, TABLES, WOOD, Scene, Shot, shoot, stand

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

SIZES = [(640, 480), (848, 480), (1280, 720)]
FLAT = (0.28 / 0.0025) ** 2


def spread(values: list[float]) -> str:
    size = np.abs(values)
    return f"median {np.median(size):.3f}, 95 % {np.percentile(size, 95):.3f}, max {size.max():.3f} (n {len(size)})"


def see(shot: Shot, lens: Intrinsics) -> FrameResult:
    return analyze_frame(shot.rgb, shot.depth, lens, rng=np.random.default_rng(0))


def word_error(one: FrameResult, two: FrameResult) -> float:
    """Degrees between two results' axes; 90 if only one has a direction."""
    one, two = one.cloth_state.word, two.cloth_state.word
    return axis_error(one, two) if one.any() == two.any() else 90.0


def by_true_pose(seen: FrameResult, shot: Shot) -> FrameResult:
    """The same frame with the camera's true pose."""
    normal, distance = shot.camera.cam_to_world[2, :3].copy(), float(shot.camera.position[2])
    truth = TablePlane(normal=normal, distance_m=distance, rms_m=0.0, inlier_share=1.0, n_inliers=1)
    pipeline = PerceptionPipeline(truth.camera(shot.lens), seen.config)
    state = pipeline.see(shot.rgb, shot.depth, seen.cloth_mask)[0]
    return replace(seen, cloth_state=state, plane=truth)


def report(title: str, names: tuple[str, ...], found) -> None:
    print(f"\n{title}")
    for name, values in zip(names, zip(*found, strict=True), strict=True):
        print(f"  {name}: {spread(list(values))}")


def errors(seen: FrameResult, shot: Shot) -> tuple[float, float, float, float]:
    """Plane in degrees and in mm under the cloth's corners, word_axial in degrees, contact as a portion."""
    expected = by_true_pose(seen, shot)
    corners = np.array([[x, y, 0.0] for x in (-0.14, 0.14) for y in (-0.14, 0.14)])
    local = (corners - shot.camera.position) @ shot.camera.cam_to_world[:3, :3]
    return (
        math.degrees(math.acos(min(1.0, float(seen.plane.normal @ expected.plane.normal)))),
        1000 * float(np.abs(local @ seen.plane.normal + seen.plane.distance_m).max()),
        word_error(seen, expected),
        (seen.cloth_state.contact_pixels - expected.cloth_state.contact_pixels) / FLAT,
    )


@pytest.mark.parametrize(("noise", "missing"), [(0.0, 0.0), (0.0026, 0.01), (0.0026, 0.2), (0.0052, 0.2)])
def test_against_the_true_pose(noise, missing):
    colors = list(CLOTHS.values())
    found = []
    poses = itertools.product((0, 20, 40, 55), (-20, 0, 15), (0.6, 0.8, 1.1))
    for k, (tilt, roll, distance) in enumerate(poses):
        width, height = SIZES[k % 3]
        camera, lens = stand(tilt=tilt, roll=roll, distance=distance, width=width, height=height)
        rng = np.random.default_rng(7000 + k)
        scene = Scene(
            cloth=colors[k % 8],
            box=colors[(k + 3) % 8],
            side=0.28,
            centre=tuple(rng.uniform(-0.03, 0.03, 2)),
            yaw=rng.uniform(-40, 40),
            normal=rng.uniform(-90, 90),
            lift_from=rng.uniform(0.02, 0.3),
        )
        shot = shoot(scene, camera, lens, seed=500 + k, depth_noise=noise, missing=missing)
        found.append(errors(see(shot, lens), shot))
    names = ("plane, degrees", "plane, mm", "word_axial, degrees", "contact portion")
    report(f"noise {1000 * noise:g} mm at 1 m, missing {missing:g}", names, found)
    degrees, millimetres, axis, contact = np.abs(np.array(found)).T
    assert degrees.max() < 0.3
    assert millimetres.max() < 1.0
    assert np.median(axis) < 0.5
    assert axis.max() < 5.0
    assert contact.mean() < 0.01


@pytest.mark.parametrize(("focal", "centre_px"), [(1.01, 0), (1.03, 0), (1.0, 10), (1.03, 20)])
def test_wrong_intrinsics(focal, centre_px):
    """What the assumed intrinsics cost where they are not the camera's."""
    found = []
    for k in range(18):
        rng = np.random.default_rng(8000 + k)
        camera, lens = stand(tilt=rng.uniform(0, 50), roll=rng.uniform(-20, 20), distance=rng.uniform(0.6, 1.0))
        scene = Scene(side=0.28, normal=rng.uniform(-90, 90), lift_from=rng.uniform(0.02, 0.3))
        shot = shoot(scene, camera, lens, seed=k, missing=0.05)
        wrong = replace(lens, fx=focal * lens.fx, fy=focal * lens.fy, cx=lens.cx + centre_px, cy=lens.cy - centre_px)
        right, other = see(shot, lens), see(shot, wrong)
        shares = [seen.cloth_state.contact_pixels / seen.cloth_state.cloth_pixels for seen in (right, other)]
        found.append((right.plane.tilt_deg - other.plane.tilt_deg, word_error(right, other), shares[1] - shares[0]))
    title = f"focal length times {focal:g}, centre off by {centre_px:g} px both ways"
    report(title, ("tilt, degrees", "word_axial, degrees", "contact share"), found)
    assert np.median(np.abs(found), axis=0)[1] < 2.0
    assert np.abs(found)[:, 2].mean() < 0.03


def test_share_of_colours_found():
    """IoU above 0.95, under changing exposure, white balance and a light that falls off across the picture."""
    suggested, learned, tried = Counter[str](), Counter[str](), Counter[str]()
    for (cloth, rgb), (name, table) in itertools.product(CLOTHS.items(), (TABLES | {"wood": WOOD}).items()):
        for seed in range(5):
            shot, rng = _lit(cloth, rgb, table, seed, [seed, len(cloth), len(name), 9])
            rows, columns = np.nonzero(cv2.erode(shot.cloth.astype(np.uint8), np.ones((9, 9), np.uint8)))
            pick = rng.integers(len(rows))
            at = (int(columns[pick]), int(rows[pick]))
            tried[name] += 1
            suggested[name] += _overlap(shot, None, None) > 0.95
            learned[name] += _overlap(shot, learn_hsv(shot.rgb, at), at) > 0.95
    for name in tried:
        print(f"\n{name}: suggested {suggested[name]}, learned {learned[name]} of {tried[name]}", end="")
    assert sum(suggested[name] for name in TABLES) > 0.95 * sum(tried[name] for name in TABLES)
    assert sum(learned[name] for name in TABLES) > 0.95 * sum(tried[name] for name in TABLES)


def _lit(cloth, rgb, table, seed, entropy) -> tuple[Shot, np.random.Generator]:
    rng = np.random.default_rng(entropy)
    width, height = [(640, 480), (848, 480), (424, 240)][seed % 3]
    camera, lens = stand(
        tilt=rng.uniform(0, 55), roll=rng.uniform(-20, 20), distance=rng.uniform(0.65, 1.1), width=width, height=height
    )
    others = [name for name in CLOTHS if name != cloth]
    scene = Scene(
        cloth=rgb,
        table=table,
        normal=rng.uniform(-90, 90),
        yaw=rng.uniform(-40, 40),
        amplitude=rng.uniform(0, 0.005),
        box=CLOTHS[others[rng.integers(7)]],
        ambient=rng.uniform(0.2, 0.6),
        lift_from=float(rng.choice([np.inf, 0.1])),
    )
    shot = shoot(scene, camera, lens, seed=seed + 900, missing=0.05)
    gain = rng.uniform(0.6, 1.05) * rng.uniform(0.9, 1.1, 3)
    fall = np.linspace(1, rng.uniform(0.6, 1), width)[None, :, None]
    picture = np.clip(shot.rgb * gain * fall + rng.normal(0, 3, shot.rgb.shape), 0, 255).astype(np.uint8)
    return replace(shot, rgb=picture), rng


def _overlap(shot: Shot, color: HsvRange | None, at: tuple[int, int] | None) -> float:
    """Intersection over union of the cloth that is taken and the true one; 0 where the frame is refused."""
    try:
        seen = analyze_frame(shot.rgb, shot.depth, shot.lens, color=color, cloth_at=at, rng=np.random.default_rng(0))
    except PerceptionError:
        return 0.0
    return float((seen.cloth_mask & shot.cloth).sum() / (seen.cloth_mask | shot.cloth).sum())


def test_a_plane_in_the_whole_image_is_as_good():
    """Without the cloth's mask, as when its colour is being looked for."""
    found = []
    for k in range(12):
        camera, lens = stand(tilt=5.0 * k, roll=3.0 * k - 18, width=424, height=240)
        shot = shoot(Scene(box=CLOTHS["red"]), camera, lens, seed=k, missing=0.1)
        plane = fit_table_plane(shot.depth, lens, rng=np.random.default_rng(0))
        found.append(1000 * (plane.distance_m - float(camera.position[2])))
    print(f"\nwithout the cloth's mask: distance off by {spread(found)} mm")
    assert np.abs(found).max() < 4.0
