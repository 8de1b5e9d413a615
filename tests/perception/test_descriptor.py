"""What every Descriptor owes its callers; a new one adds itself to DESCRIPTORS."""

from __future__ import annotations

import numpy as np
import pytest

from perception.descriptor import Descriptor
from perception.descriptors import DESCRIPTORS
from perception.tableview import ClothView


def random_view(seed: int, cloth: bool = True) -> ClothView:
    shape = (60, 70)
    mask = np.zeros(shape, dtype=bool)
    mask[8:-8, 8:-8] = cloth
    rgb = np.random.default_rng(seed).integers(0, 255, (*shape, 3), dtype=np.uint8)
    return ClothView(rgb=rgb, cloth=mask, contact=mask, height=np.zeros(shape, np.float32), mm_per_px=2.5)


@pytest.mark.parametrize("descriptor", [make() for make in DESCRIPTORS.values()], ids=DESCRIPTORS.keys())
def test_descriptor_contract(descriptor: Descriptor) -> None:
    assert isinstance(descriptor, Descriptor)
    assert descriptor.name
    view = random_view(0)
    before = view.rgb.copy()
    vector = descriptor.describe(view)
    assert vector.shape == (descriptor.size,)
    assert vector.dtype == np.float64
    assert np.isfinite(vector).all()
    np.testing.assert_array_equal(descriptor.describe(view), vector)
    np.testing.assert_array_equal(view.rgb, before)
    assert not descriptor.describe(random_view(0, cloth=False)).any()
