"""Calibrations on rendered scenes whose truth is known."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from layflat.app.hardware.calibration.cloth import calibrate_cloth
from layflat.app.hardware.calibration.hand_eye import Board, BoardView, calibrate_camera, find_board
from layflat.app.hardware.calibration.table import calibrate_table
from layflat.app.support.errors import UsageError
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.sim.camera.camera import D435_NOISE, Camera, default_pinhole
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.physics.registry import make_world

INTRINSICS = Intrinsics.d435(640, 480)
BOARD, SQUARE_PX = Board(), 40


def pose(turn: NDArray, place: NDArray) -> NDArray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), place
    return matrix


def picture(board_pose: NDArray, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Render the printed board with four samples a pixel and a camera's noise."""
    sheet = BOARD.charuco().generateImage((BOARD.columns * SQUARE_PX, BOARD.rows * SQUARE_PX), marginSize=0)
    camera = np.array([[INTRINSICS.fx, 0, INTRINSICS.cx], [0, INTRINSICS.fy, INTRINSICS.cy], [0, 0, 1]])
    to_metres = np.diag([BOARD.square_m / SQUARE_PX, BOARD.square_m / SQUARE_PX, 1.0])
    to_metres[:2, 2] = 0.5 * BOARD.square_m / SQUARE_PX
    finer = np.array([[4.0, 0, 1.5], [0, 4.0, 1.5], [0, 0, 1]])
    view = finer @ camera @ board_pose[:3, [0, 1, 3]] @ to_metres
    drawn = cv2.warpPerspective(sheet, view, (640 * 4, 480 * 4), borderValue=170)
    small = cv2.resize(drawn, (640, 480), interpolation=cv2.INTER_AREA) + rng.normal(0, 2, (480, 640))
    return np.repeat(np.clip(small, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def test_hand_eye_within_a_millimetre_and_a_fifth_of_a_degree() -> None:
    rng = np.random.default_rng(77)
    truth, held = np.array(default_pinhole().cam_to_world), pose(np.array([1.7, 0.2, 0.1]), np.array([-0.1, 0, 0.05]))
    hands: list[NDArray] = []
    views: list[BoardView] = []
    while len(views) < 12:
        place = np.array([rng.uniform(-0.15, 0.05), rng.uniform(-0.12, 0.02), rng.uniform(0.45, 0.7)])
        seen = pose(rng.uniform(-0.5, 0.5, 3), place)
        view = find_board(picture(seen, rng), BOARD)
        if view is not None:
            hand = truth @ seen @ np.linalg.inv(held)
            # A Panda repeats a pose within 0.1 mm.
            hand[:3, 3] += rng.normal(0, 1e-4, 3)
            hands.append(hand)
            views.append(view)
    found = calibrate_camera(hands, views, INTRINSICS)
    off = np.linalg.inv(truth) @ found.cam_to_world
    assert np.linalg.norm(off[:3, 3]) < 1e-3
    assert np.rad2deg(Rotation.from_matrix(off[:3, :3]).magnitude()) < 0.2
    assert found.rms_m < 1e-3


def test_too_few_and_too_similar_poses_are_refused() -> None:
    view = BoardView(corners_m=np.zeros((6, 3)), pixels=np.zeros((6, 2)))
    with pytest.raises(UsageError, match="seen in 2 poses; at least 5"):
        calibrate_camera([np.eye(4)] * 2, [view] * 2, INTRINSICS)
    with pytest.raises(UsageError, match="differ by 0 degrees"):
        calibrate_camera([np.eye(4)] * 6, [view] * 6, INTRINSICS)


def test_no_board_in_the_picture() -> None:
    assert find_board(np.full((480, 640, 3), 128, np.uint8), BOARD) is None


@pytest.fixture(scope="module")
def flat_scene() -> tuple[NDArray[np.uint8], list[NDArray[np.float32]]]:
    """Return the bench camera's picture of a towel that lies flat, and fifteen depth images."""
    world = make_world(substep_s=1 / 240)
    spec = cloth_spec("towel")
    camera = Camera(world.add_cloth(spec), noise=D435_NOISE, seed=3)
    rgb, depth = camera.capture(spec.flat_nodes())
    depths = [depth, *(camera.capture(spec.flat_nodes())[1] for _ in range(14))]
    world.close()
    return rgb, depths


def test_the_table_corrects_tilt_and_height(flat_scene: tuple[NDArray, list[NDArray]]) -> None:
    truth = np.array(default_pinhole().cam_to_world)
    wrong = pose(np.deg2rad([1.5, -1.0, 0.0]), np.zeros(3)) @ truth
    wrong[2, 3] += 0.02
    pinhole = default_pinhole()
    intrinsics = Intrinsics(
        width=pinhole.width, height=pinhole.height, fx=pinhole.fx, fy=pinhole.fy, cx=pinhole.cx, cy=pinhole.cy
    )
    found = calibrate_table(flat_scene[1], intrinsics, wrong)
    # The towel lies 4 mm above the table.
    assert found.cam_to_world[2, 3] == pytest.approx(truth[2, 3], abs=0.003)
    up = found.cam_to_world[:3, :3] @ truth[:3, :3].T @ [0, 0, 1]
    assert np.rad2deg(np.arccos(up[2])) < 0.3
    assert found.turned_deg == pytest.approx(np.hypot(1.5, 1.0), abs=0.3)


def test_the_cloth_laid_flat(flat_scene: tuple[NDArray, list[NDArray]]) -> None:
    rgb, depths = flat_scene
    pinhole = default_pinhole()
    found = calibrate_cloth(rgb, depths[0], pinhole, cloth_spec("towel"))
    assert found.area_m2 == pytest.approx(cloth_spec("towel").length_m * cloth_spec("towel").width_m, rel=0.05)
    assert found.contact_portion > 0.97
    with pytest.raises(UsageError, match=r"napkin has \d+: lay it flat"):
        calibrate_cloth(rgb, depths[0], pinhole, cloth_spec("napkin"))
