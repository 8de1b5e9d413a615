"""Hand-eye calibration: where the camera is, from a ChArUco board in the robot's hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from layflat.app.support.errors import UsageError
from layflat.data.arrays import FloatArray
from layflat.perception.camera.intrinsics import Intrinsics

MIN_POSES, MIN_CORNERS = 5, 6
MIN_TURN_DEG = 10.0
"""Poses that are turned by less than this, all of them, do not tell where the camera is."""


@dataclass(frozen=True, kw_only=True)
class Board:
    """A printed ChArUco board."""

    columns: int = 7
    rows: int = 5
    square_m: float = 0.030
    marker_m: float = 0.022

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's board."""
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, dictionary)


@dataclass(frozen=True, kw_only=True)
class HandEye:
    """The camera's pose, and how well the poses agree."""

    cam_to_world: FloatArray
    """(4, 4)."""
    rms_m: float
    """Of the board's corners in space, between where the robot and where the camera put them."""
    rms_px: float
    n_poses: int


@dataclass(frozen=True, kw_only=True)
class BoardView:
    """Corners of the board in one picture."""

    corners_m: FloatArray
    """(N, 3) m, board axes."""
    pixels: FloatArray
    """(N, 2) column, row."""


def find_board(rgb: NDArray[np.uint8], board: Board) -> BoardView | None:
    """Return the board's corners in a picture (H, W, 3), or None where too few are seen."""
    charuco = board.charuco()
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    pixels, numbers, _, _ = cv2.aruco.CharucoDetector(charuco).detectBoard(grey)
    if numbers is None or len(numbers) < MIN_CORNERS:
        return None
    corners = np.asarray(charuco.getChessboardCorners(), dtype=float)[numbers.ravel()]
    return BoardView(corners_m=corners, pixels=np.asarray(pixels, dtype=float).reshape(-1, 2))


def calibrate_camera(hands: Sequence[FloatArray], views: Sequence[BoardView], intrinsics: Intrinsics) -> HandEye:
    """Return the camera's pose from poses of the hand (4, 4), world, and what the camera saw there.

    OpenCV's closed form (Park and Martin 1994) begins; then all corners' pixels are fitted at once. UsageError where
    the poses are too few or too much alike.
    """
    if len(views) < MIN_POSES:
        raise UsageError(f"the board was seen in {len(views)} poses; at least {MIN_POSES} are needed")
    turns = [Rotation.from_matrix(hand[:3, :3]) for hand in hands]
    widest = max(np.rad2deg((turns[0].inv() * turn).magnitude()) for turn in turns)
    if widest < MIN_TURN_DEG:
        raise UsageError(f"the poses differ by {widest:.0f} degrees; turn the hand by {MIN_TURN_DEG:.0f} or more")
    camera = np.array([[intrinsics.fx, 0, intrinsics.cx], [0, intrinsics.fy, intrinsics.cy], [0, 0, 1.0]])
    boards = [_board_pose(view, camera) for view in views]
    # Eye to hand: with the hand's poses inverted the solver's "camera to gripper" is the camera's pose in the world.
    inverse = [np.linalg.inv(hand) for hand in hands]
    turn, place = cv2.calibrateHandEye(
        [m[:3, :3] for m in inverse],
        [m[:3, 3] for m in inverse],
        [m[:3, :3] for m in boards],
        [m[:3, 3] for m in boards],
        method=cv2.CALIB_HAND_EYE_PARK,
    )
    pose = _matrix(Rotation.from_matrix(turn).as_rotvec(), np.asarray(place, dtype=float).ravel())
    attached = [np.linalg.inv(hand) @ pose @ seen for hand, seen in zip(hands, boards, strict=True)]
    mean_turn = Rotation.from_matrix([m[:3, :3] for m in attached]).mean()
    start = np.concatenate([_vector(pose), mean_turn.as_rotvec(), np.mean([m[:3, 3] for m in attached], axis=0)])

    def errors(x: FloatArray) -> FloatArray:
        to_camera, held = np.linalg.inv(_matrix(x[:3], x[3:6])), _matrix(x[6:9], x[9:12])
        rest = []
        for hand, view in zip(hands, views, strict=True):
            local = _transform(to_camera @ hand @ held, view.corners_m) @ camera.T
            rest.append((local[:, :2] / local[:, 2:] - view.pixels).ravel())
        return np.concatenate(rest)

    fitted = least_squares(errors, start, method="lm")
    pose, held = _matrix(fitted.x[:3], fitted.x[3:6]), _matrix(fitted.x[6:9], fitted.x[9:12])
    apart = [
        _transform(hand @ held, view.corners_m) - _transform(pose @ seen, view.corners_m)
        for hand, view, seen in zip(hands, views, boards, strict=True)
    ]
    return HandEye(
        cam_to_world=pose,
        rms_m=float(np.sqrt(np.mean(np.sum(np.concatenate(apart) ** 2, axis=1)))),
        rms_px=float(np.sqrt(np.mean(fitted.fun**2) * 2)),
        n_poses=len(views),
    )


def _board_pose(view: BoardView, camera: FloatArray) -> FloatArray:
    found, turn, place = cv2.solvePnP(view.corners_m, view.pixels, camera, None)
    if not found:
        raise UsageError("the board's pose does not follow from its corners")
    return _matrix(np.asarray(turn, dtype=float).ravel(), np.asarray(place, dtype=float).ravel())


def _matrix(turn: FloatArray, place: FloatArray) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), place
    return pose


def _vector(pose: FloatArray) -> FloatArray:
    return np.concatenate([Rotation.from_matrix(pose[:3, :3]).as_rotvec(), pose[:3, 3]])


def _transform(pose: FloatArray, points: FloatArray) -> FloatArray:
    return points @ pose[:3, :3].T + pose[:3, 3]
