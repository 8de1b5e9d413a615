"""HOG's own properties. What all descriptors owe is in test_descriptor."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.descriptors.hog import HogConfig, HogDescriptor
from layflat.perception.errors import PerceptionError


def striped(normal: float, *, rows: int = 140, columns: int = 140) -> ClothView:
    """A cloth with sine stripes of 58 mm and 10 %, perpendicular at ``normal`` rad from +x (y up)."""
    shape = (rows + 20, columns + 20)
    row, column = np.mgrid[: shape[0], : shape[1]]
    along = (column * math.cos(normal) - row * math.sin(normal)) * 2.5
    cloth = np.zeros(shape, dtype=bool)
    cloth[10:-10, 10:-10] = True
    shade = 1 + 0.1 * np.sin(2 * math.pi * along / 58.0)
    rgb = np.where(cloth[..., None], np.array([40.0, 90.0, 200.0]) * shade[..., None], 205.0)
    height = np.full(shape, 0.004, np.float32)
    return ClothView(rgb=np.rint(rgb).astype(np.uint8), cloth=cloth, contact=cloth, height=height, mm_per_px=2.5)


def test_size_is_dalals_and_triggs_for_the_window() -> None:
    assert HogDescriptor().size == 7 * 7 * 4 * 9
    assert HogDescriptor(HogConfig(window_px=128, cell_px=16, bins=6)).size == 7 * 7 * 4 * 6


def test_blocks_have_unit_length() -> None:
    """L2-Hys ends with a normalisation; OpenCV adds 0.001 to a length that the clipping has left at 0.4 or more."""
    blocks = HogDescriptor().describe(striped(0.4)).reshape(49, 36)
    np.testing.assert_allclose(np.linalg.norm(blocks, axis=1), 1.0, atol=0.0025)


@pytest.mark.parametrize("bin_index", range(9))
def test_the_fullest_bin_is_across_the_wrinkles(bin_index: int) -> None:
    """Bins are centred on 10, 30 ... 170 degrees from the columns' axis, rows down; the table's y is up."""
    normal = -math.radians(10 + 20 * bin_index)
    blocks = HogDescriptor().describe(striped(normal)).reshape(-1, 9)
    assert int(blocks.sum(axis=0).argmax()) == bin_index


@pytest.mark.parametrize("shape", [(60, 140), (140, 60)])
@pytest.mark.parametrize("normal", [math.pi / 4, -math.pi / 4, 0.3])
def test_an_oblong_cloth_does_not_turn_its_wrinkles(shape: tuple[int, int], normal: float) -> None:
    vector = HogDescriptor().direction(striped(normal, rows=shape[0], columns=shape[1])).vector
    assert math.degrees(math.atan2(vector[1], vector[0])) == pytest.approx(math.degrees(normal), abs=3.0)


def test_opencv_without_hog_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "HOGDescriptor")
    with pytest.raises(PerceptionError, match="install opencv-python-headless 4"):
        HogDescriptor()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"window_px": 60}, "a window of 60 px does not hold two or more whole cells of 8 px"),
        ({"window_px": 8}, "a window of 8 px"),
        ({"bins": 1}, "bins is 1"),
        ({"noise_floor": -1.0}, "noise_floor -1.0"),
    ],
)
def test_impossible_settings_are_refused(wrong: dict, said: str) -> None:
    with pytest.raises(PerceptionError, match=said):
        HogConfig(**wrong)
