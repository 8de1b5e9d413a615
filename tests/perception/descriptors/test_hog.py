"""HOG's own properties. What all descriptors owe is in test_conformance."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from layflat.perception.descriptors.hog import HogConfig, HogDescriptor
from layflat.perception.errors import PerceptionError
from layflat.tests.perception.factories import striped_view


def test_size_is_dalals_and_triggs_for_the_window():
    assert HogDescriptor().size == 7 * 7 * 4 * 9
    assert HogDescriptor(HogConfig(window_px=128, cell_px=16, bins=6)).size == 7 * 7 * 4 * 6


def test_blocks_have_unit_length():
    """L2-Hys ends with a normalisation; OpenCV adds 0.001 to a length that the clipping has left at 0.4 or more."""
    blocks = HogDescriptor().describe(striped_view(0.4)).reshape(49, 36)
    np.testing.assert_allclose(np.linalg.norm(blocks, axis=1), 1.0, atol=0.0025)


@pytest.mark.parametrize("bin_index", range(9))
def test_the_fullest_bin_is_across_the_wrinkles(bin_index):
    """Bins are centred on 10, 30 ... 170 degrees from the columns' axis, rows down; the table's y is up."""
    blocks = HogDescriptor().describe(striped_view(-math.radians(10 + 20 * bin_index))).reshape(-1, 9)
    assert int(blocks.sum(axis=0).argmax()) == bin_index


@pytest.mark.parametrize("shape", [(60, 140), (140, 60)])
@pytest.mark.parametrize("normal", [math.pi / 4, -math.pi / 4, 0.3])
def test_an_oblong_cloth_does_not_turn_its_wrinkles(shape, normal):
    vector = HogDescriptor().direction(striped_view(normal, shape=shape)).vector
    assert math.degrees(math.atan2(vector[1], vector[0])) == pytest.approx(math.degrees(normal), abs=3.0)


def test_opencv_without_hog_is_one_sentence(monkeypatch):
    monkeypatch.delattr(cv2, "HOGDescriptor")
    with pytest.raises(PerceptionError, match="install opencv-python-headless 4"):
        HogDescriptor()
