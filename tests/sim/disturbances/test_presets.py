"""Disturbances as plain values: what a suite's file may say, and what is refused."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.disturbances.presets import DISTURBANCES, DisturbanceSpec, DisturbanceTrajectory, disturbance_spec
from layflat.sim.errors import SimError
from layflat.tests.sim.helpers import simulation

TOWEL = cloth_spec("towel")


@pytest.mark.parametrize("name", sorted(DISTURBANCES))
def test_a_preset_written_out_is_read_back(name: str) -> None:
    spec = disturbance_spec(name)
    plain = {k: [list(v) if isinstance(v, tuple) else v for v in values] if isinstance(values, tuple) else values
             for k, values in asdict(spec).items()}  # fmt: skip
    assert DisturbanceSpec.from_mapping(plain) == spec
    assert DisturbanceSpec.from_mapping({"like": name}) == spec


def test_a_suites_file_says_what_differs() -> None:
    spec = DisturbanceSpec.from_mapping(
        {"name": "half", "like": "thesis", "scale": [0.3, 0.4], "across": 0.5, "force_weights": 2}
    )
    known = disturbance_spec("thesis")
    assert (spec.name, spec.scale, spec.across, spec.force_weights) == ("half", (0.3, 0.4), (0.5, 0.5), 2.0)
    assert (spec.path, spec.along, spec.kind) == (known.path, known.along, known.kind)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"name": ""}, "name"),
        ({"name": 3, "like": "push"}, "name"),
        ({"kind": "push"}, "name"),
        ({"name": "odd"}, "kind"),
        ({"name": "odd", "like": "storm"}, "storm"),
        ({"name": "odd", "like": 3}, "like"),
        ({"name": "odd", "kind": "shove"}, "shove"),
    ],
)
def test_a_wrong_name_or_kind_is_refused_in_one_sentence(wrong: dict, said: str) -> None:
    with pytest.raises(SimError, match=rf"\A.*{said}.*\Z"):
        DisturbanceSpec.from_mapping(wrong)


@pytest.mark.parametrize(
    ("like", "field", "value"),
    [
        ("push", "colour", "red"),
        ("push", "along", "far"),
        ("push", "along", [0.1]),
        ("push", "along", [0.9, 0.1]),
        ("push", "scale", [0.9, 0.1]),
        ("push", "across", [0.0, 1.5]),
        ("push", "patch", [1.5, 2]),
        ("push", "patch", 3),
        ("push", "patch", [0, 3]),
        ("push", "path", []),
        ("push", "path", [[1.0]]),
        ("push", "path", "up"),
        ("push", "speed_m_s", True),
        ("push", "speed_m_s", math.nan),
        ("push", "speed_m_s", 0.0),
        ("push", "force_weights", -1.0),
        ("push", "settle_s", -1.0),
        ("push", "wind_m_s2", 1.0),
        ("none", "path", [[0.1, 0.0]]),
        ("push", "either_side", 1),
        ("wind", "wind_m_s2", 0),
        ("wind", "turn_deg", 90.0),
        ("fold-corner", "turn_deg", "over"),
    ],
)
def test_a_wrong_value_is_named_with_its_field(like: str, field: str, value: object) -> None:
    with pytest.raises(SimError, match=rf"\Adisturbance odd: .*{field}.*\Z"):
        DisturbanceSpec.from_mapping({"name": "odd", "like": like, field: value})


@given(seed=st.integers(0, 2**32 - 1))
def test_a_corner_is_folded_inwards_and_turned_over_as_one_turns_a_page(seed: int) -> None:
    """What lies behind in the heading is above on the way, and ahead at the end; what lies beside stays beside."""
    plan = disturbance_spec("fold-corner").sample(np.random.default_rng(seed), TOWEL)
    side = np.sign(TOWEL.flat_nodes()[list(plan.nodes), 1].mean())
    assert (0 if side > 0 else TOWEL.columns - 1) in plan.nodes
    assert plan.path_m[-1, 0] > 0.05
    assert plan.path_m[-1, 1] * side < 0
    ahead = plan.path_m[-1] * [1.0, 1.0, 0.0]
    ahead /= np.linalg.norm(ahead)
    up, duration_s = np.array([0.0, 0.0, 1.0]), np.linalg.norm(np.diff(plan.path_m, axis=0), axis=1).sum() / 0.25
    np.testing.assert_allclose(plan.turned(0.0), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(plan.turned(duration_s / 2) @ -ahead, up, atol=1e-9)
    for time_s in (duration_s, 2 * duration_s):
        np.testing.assert_allclose(plan.turned(time_s) @ -ahead, ahead, atol=1e-9)
        np.testing.assert_allclose(plan.turned(time_s) @ up, -up, atol=1e-9)
    on_the_spot = replace(plan, path_m=0 * plan.path_m)
    np.testing.assert_allclose(on_the_spot.turned(0.0) @ -ahead, ahead, atol=1e-9)
    straight = disturbance_spec("push").sample(np.random.default_rng(seed), TOWEL)
    np.testing.assert_array_equal(straight.turned(0.4), np.eye(3))


def test_both_sides_occur() -> None:
    fold = disturbance_spec("fold-corner")
    assert {0 in fold.sample(np.random.default_rng(seed), TOWEL).nodes for seed in range(20)} == {True, False}


def test_repeats_differ_and_the_first_is_what_it_always_was() -> None:
    known = disturbance_spec("thesis").sample(np.random.default_rng([7, 0xD157]), TOWEL)
    kinds = (("thesis", 0), (disturbance_spec("thesis"), 0), ("thesis", 1), ("thesis", 1))
    with simulation(cloth="towel", seed=7) as sim:
        first, named, second, again = (sim.disturb(what, repeat).plan for what, repeat in kinds)  # type: ignore[union-attr]
    assert first == named == known.described()
    assert second == again != first


def test_a_record_is_repeated_exactly_and_none_does_nothing() -> None:
    with simulation(seed=7) as sim:
        record = sim.disturb("push", 3)
        assert record is not None
        assert sim.disturb(record, 5) == record
        assert sim.disturb(replace(record, plan={}), 3) == record
        assert sim.disturb("none") is None
        sim.step(sim.spec.robot.zeros())
        assert not sim.disturbed


@pytest.mark.parametrize("name", DISTURBANCES)
def test_a_trajectory_survives_its_description_as_json(name: str) -> None:
    plan = DISTURBANCES[name].sample(np.random.default_rng(4), TOWEL)
    again = DisturbanceTrajectory.recorded(json.loads(json.dumps(plan.described())), TOWEL)
    assert again.described() == plan.described() == json.loads(json.dumps(plan.described()))
    assert all(type(getattr(again, key)) is type(value) for key, value in vars(plan).items())
    for time_s in (0.0, 0.3, 2.0):
        for a, b in zip(again.target(time_s), plan.target(time_s), strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_trajectory_without_a_turn_does_not_turn() -> None:
    plan = DISTURBANCES["push"].sample(np.random.default_rng(0), TOWEL).described()
    described = {key: value for key, value in plan.items() if key != "turn_rad"}
    assert DisturbanceTrajectory.recorded(described, TOWEL).described() == plan
    for broken in ([1.0, 2.0], "over", [math.nan, 0.0, 0.0]):
        with pytest.raises(SimError, match=r"cannot be read|does not fit"):
            DisturbanceTrajectory.recorded({**plan, "turn_rad": broken}, TOWEL)
