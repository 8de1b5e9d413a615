from __future__ import annotations

from dataclasses import replace

import pytest

from layflat.policy import registry
from layflat.policy.base import PolicyError
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import demonstrations, gp_model, trained_model


@pytest.mark.parametrize("name", ["GP-WORD", "gp", ""])
def test_unknown_trainable_policies_list_the_known(name):
    with pytest.raises(PolicyError, match="gp-word, gp-baseline"):
        registry.train(name, [])


def test_unknown_and_untrained_policies_are_distinguished():
    with pytest.raises(PolicyError, match="drag-rule"):
        registry.make("magic", HANGER)
    with pytest.raises(PolicyError, match="is learned"):
        registry.make("gp-word", HANGER)
    with pytest.raises(PolicyError, match="must be one of steady, recovery"):
        registry.wrap(registry.make("hold", HANGER), ["magic"])


def test_training_without_demonstrations_is_refused():
    with pytest.raises(PolicyError, match="no demonstrations"):
        registry.train("gp-word", [])


def test_a_model_makes_the_policy_that_it_names():
    assert registry.from_model(gp_model()).name == "gp-word"
    with pytest.raises(PolicyError, match="'magic' is unknown"):
        registry.from_model(gp_model(policy="magic"))
    with pytest.raises(PolicyError, match="cannot be run as dmp"):
        registry.from_model(replace(trained_model("nearest", HANGER), policy="dmp"))


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
