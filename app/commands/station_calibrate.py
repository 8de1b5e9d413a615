"""`layflat station calibrate`: where the camera is, and how the cloth looks, into the station's file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from layflat.app.hardware.calibration.cloth import calibrate_cloth
from layflat.app.hardware.calibration.hand_eye import Board, BoardView, calibrate_camera, find_board
from layflat.app.hardware.calibration.table import FRAMES, calibrate_table
from layflat.app.hardware.franka_arm import FrankaArm
from layflat.app.hardware.realsense_camera import RealSenseCamera, open_camera
from layflat.app.hardware.station_config import StationConfig, read_station, update_station
from layflat.app.support import validators
from layflat.app.support.errors import UsageError, say

KINDS = ("table", "camera", "cloth")


@dataclass(frozen=True, kw_only=True)
class CalibrateConfig:
    """Settings of one `layflat station calibrate` call."""

    kind: str
    station: Path
    poses: int = 12
    at: tuple[int, int] | None = None


def calibrate(config: CalibrateConfig) -> None:
    """Measure where the camera is, or how the cloth looks, and write it into the station's file."""
    validators.one_of("calibration", config.kind, KINDS)
    station = read_station(config.station)
    with closing(open_camera(station.camera)) as camera:
        if config.kind == "table":
            values, text = _table(station, camera)
        elif config.kind == "cloth":
            values, text = _cloth(station, camera, config.at)
        else:
            with closing_arm(FrankaArm(station.robot)) as arm:
                values, text = _hand_eye(arm, camera, config.poses)
    update_station(config.station, "camera", values)
    print(text)
    print(f"wrote {config.station}")


def _table(station: StationConfig, camera: RealSenseCamera) -> tuple[dict[str, Any], str]:
    depths, newest = [], camera.frame()
    for _ in range(FRAMES):
        depths.append(newest.depth)
        newest = camera.frame(after_s=newest.seen_s + 1e-6)
    found = calibrate_table(depths, camera.intrinsics, station.camera.cam_to_world())
    text = (
        f"turned by {found.turned_deg:.2f} degrees, raised by {1e3 * found.raised_m:.1f} mm; the depth scatters by "
        f"{1e3 * found.rms_m:.1f} mm about the table, which holds {100 * found.inlier_share:.0f} % of it"
    )
    return _pose_values(found.cam_to_world), text


def _cloth(station: StationConfig, camera: RealSenseCamera, at: tuple[int, int] | None) -> tuple[dict[str, Any], str]:
    frame, pose = camera.frame(), station.camera.cam_to_world()
    found = calibrate_cloth(frame.rgb, frame.depth, camera.intrinsics.camera_at(pose), station.cloth_spec(), at)
    values = {
        "flat_pixels": found.flat_pixels,
        "hue_deg": [found.color.hue_min, found.color.hue_max],
        "saturation_min": found.color.saturation_min,
        "value_min": found.color.value_min,
    }
    flat = f"{found.flat_pixels} pixels, {1e4 * found.area_m2:.0f} cm2, {100 * found.contact_portion:.0f} % of it flat"
    return values, flat


def _hand_eye(arm: FrankaArm, camera: RealSenseCamera, poses: int) -> tuple[dict[str, Any], str]:
    say(f"put the board ({Board().columns} x {Board().rows} squares of {1e3 * Board().square_m:g} mm) into the hand")
    hands: list[np.ndarray] = []
    views: list[BoardView] = []
    while len(views) < poses:
        ask(f"pose {len(views) + 1} of {poses}: guide the hand, let go, and press Enter")
        place, axes = arm.pose()
        view = find_board(camera.frame().rgb, Board())
        if view is None:
            say("the board is not seen whole enough there; try another pose")
            continue
        hand = np.eye(4)
        hand[:3, :3], hand[:3, 3] = axes, place
        hands.append(hand)
        views.append(view)
    found = calibrate_camera(hands, views, camera.intrinsics)
    text = f"{found.n_poses} poses agree within {1e3 * found.rms_m:.2f} mm and {found.rms_px:.2f} px (rms)"
    return _pose_values(found.cam_to_world), text


def _pose_values(pose: np.ndarray) -> dict[str, Any]:
    turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return {
        "position_m": [round(float(value), 5) for value in pose[:3, 3]],
        "rotation_xyzw": [round(float(value), 6) for value in turn],
    }


@contextmanager
def closing_arm(arm: FrankaArm) -> Iterator[FrankaArm]:
    """Stop an arm at the end."""
    try:
        yield arm
    finally:
        arm.stop()


def ask(text: str) -> None:
    """Ask a person for something and wait for Enter; without a terminal that is an error."""
    if not sys.stdin.isatty():
        raise UsageError(f"a person must {text}; run this in a terminal")
    print(f"layflat: {text}, then press Enter (Ctrl-C stops) ", end="", file=sys.stderr, flush=True)
    sys.stdin.readline()
