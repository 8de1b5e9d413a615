"""Videos decode to the frames that were written."""

from __future__ import annotations

import resource

import cv2
import numpy as np
import pytest

from layflat.app.media.video import count_frames, write_video
from layflat.app.support.errors import LayflatError


def test_frames_come_back_in_number_order_and_colour(tmp_path):
    colours = [(200, 30, 30), (30, 200, 30), (30, 30, 200)]
    frames = [np.full((64, 96, 3), colours[k // 5], np.uint8) for k in range(15)]
    path = tmp_path / "video.webm"
    assert write_video(path, frames, fps=10) == 15 == count_frames(path)
    capture = cv2.VideoCapture(str(path))
    for k in range(15):
        _, bgr = capture.read()
        rgb = bgr[..., ::-1].reshape(-1, 3).mean(axis=0)
        assert rgb == pytest.approx(colours[k // 5], abs=25)
    capture.release()
    assert [p.name for p in tmp_path.iterdir()] == ["video.webm"]


def test_nothing_is_printed(tmp_path, capfd):
    write_video(tmp_path / "video.webm", [np.zeros((32, 32, 3), np.uint8)] * 2)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "frames", "message"),
    [
        ("video.mp4", [np.zeros((32, 32, 3), np.uint8)], "not a .webm"),
        ("video.webm", [], "no frames"),
        ("video.webm", [np.zeros((32, 32, 3), np.uint8), np.zeros((32, 48, 3), np.uint8)], "first one is"),
    ],
)
def test_a_video_that_cannot_be_written_leaves_no_file(name, frames, message, tmp_path):
    with pytest.raises(LayflatError, match=message):
        write_video(tmp_path / name, frames)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_said(tmp_path, capfd):
    """OpenCV writes on without an error."""
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 256, (64, 64, 3), dtype=np.uint8) for _ in range(20)]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        with pytest.raises(OSError, match="File too large") as caught:
            write_video(tmp_path / "v.webm", frames)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.filename == str(tmp_path / "v.webm")
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""
