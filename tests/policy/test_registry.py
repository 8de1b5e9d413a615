from __future__ import annotations

import pytest

from layflat.policy import registry
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import demonstrations


@pytest.mark.parametrize("name", registry.TRAINABLE_POLICIES)
def test_each_policy_sees_the_position_and_what_it_is_named_after(name):
    extra = {
        "gp-baseline": set(),
        "dmp": set(),
        "gp-contact": {"contact"},
        "gp-direction": {"word_x", "word_y"},
    }.get(name, {"contact", "word_x", "word_y"})
    model = registry.train(name, demonstrations(HANGER))
    assert set(model.layout.names) - {"x", "z"} == extra
    assert model.policy == name
