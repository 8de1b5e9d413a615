"""Every key of the table of conditions: what it takes, what it refuses, and that it changes what it says."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import gymnasium
import numpy as np
import pytest

import layflat
from layflat.data.cloth_frame import recorded_settings
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.policy.training_set import recorded_size
from layflat.sim.camera.camera import default_pinhole, pinhole_of
from layflat.sim.camera.renderer import LIGHT, USUAL_LIGHT, light_of
from layflat.sim.cloth.registry import CLOTHS, recorded_cloth
from layflat.sim.conditions.keys import Conditions, Key, changed, key_of, keys, parse_settings
from layflat.sim.config import SimConfig, recorded_spec
from layflat.sim.env import ClothPlaceEnv
from layflat.sim.errors import SimError
from layflat.sim.simulation import ClothSimulation

NUMBERS = [key for key in keys().values() if not key.choices]
ALL = list(keys().values())
SEEN = ("nodes", "corners", "rgb", "depth", "time")


def another(key: Key) -> Any:
    """Return a value that is not the default."""
    if key.choices:
        return next(name for name in key.choices if name != key.default)
    if key.kind is int:
        return 3 if key.default == 0 else 2 * int(key.default)
    return 0.5 * (float(key.default) + (key.high if key.high > float(key.default) else key.low))


@pytest.mark.parametrize("key", ALL, ids=lambda key: key.name)
def test_a_key_has_a_meaning_and_its_default_is_one_of_its_values(key: Key) -> None:
    assert key.about.endswith(".")
    assert key.checked(key.default) == key.default
    assert getattr(Conditions(), key.name) == key.default
    assert key.choices or (math.isfinite(key.low) and math.isfinite(key.high) and key.low < key.high)


@pytest.mark.parametrize("key", ALL, ids=lambda key: key.name)
def test_a_text_is_read_in_the_type_of_its_key(key: Key) -> None:
    value = another(key)
    assert value != key.default
    found = parse_settings([f"{key.name}={value}"])
    assert found == {key.name: value}
    assert type(found[key.name]) is key.kind


@pytest.mark.parametrize("key", NUMBERS, ids=lambda key: key.name)
def test_limits_belong_to_a_number_and_what_is_beyond_is_refused(key: Key) -> None:
    for end in (key.low, key.high):
        assert getattr(Conditions(**{key.name: key.kind(end)}), key.name) == end
    step = 1 if key.kind is int else 1e-6
    for beyond in (key.low - step, key.high + step):
        with pytest.raises(SimError, match=rf"^{key.name} is .*; it must be a .*number between"):
            SimConfig(robot="hanger", **{key.name: key.kind(beyond)})


@pytest.mark.parametrize("key", ALL, ids=lambda key: key.name)
@pytest.mark.parametrize("value", ["much", "", "nan", "inf", "1e999", "1,5", "true"])
def test_a_text_that_is_no_value_is_refused(key: Key, value: str) -> None:
    with pytest.raises(SimError, match=rf"^{key.name} is .*; it must be "):
        parse_settings([f"{key.name}={value}"])


@pytest.mark.parametrize("key", ALL, ids=lambda key: key.name)
@pytest.mark.parametrize("value", [None, True, [1.0], "0"])
def test_a_value_of_another_type_is_refused(key: Key, value: object) -> None:
    with pytest.raises(SimError, match=rf"^{key.name} is "):
        Conditions(**{key.name: value})


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["table_frictoin=1"], "unknown key 'table_frictoin'; did you mean table_friction\\? `layflat config` lists"),
        (["friction=1"], "unknown key 'friction'; did you mean .*friction"),
        (["zzz=1"], "unknown key 'zzz'; `layflat config` lists every key"),
        (["table_friction"], "'table_friction' must be KEY=VALUE"),
        (["table_friction=1", "table_friction=2"], "table_friction is set to 1.0 and to 2.0; give it once"),
        (["control=stiff"], "control is 'stiff'; it must be impedance or position"),
        (["camera_width_px=320.5"], "camera_width_px is '320.5'; it must be a whole number between 160 and 1280 px"),
    ],
)
def test_a_setting_that_is_wrong_is_refused_in_one_sentence(texts: list[str], message: str) -> None:
    with pytest.raises(SimError, match=f"^(setting )?{message}"):
        parse_settings(texts)


def test_the_usual_conditions_are_those_before_there_were_keys() -> None:
    config = SimConfig(robot="hanger")
    assert config.cloth_spec == CLOTHS["towel"]
    assert pinhole_of(config).cam_to_world.tobytes() == default_pinhole().cam_to_world.tobytes()
    assert (default_pinhole().width, default_pinhole().height) == (320, 240)
    light = light_of(config)
    assert light.direction.tobytes() == LIGHT.tobytes() == USUAL_LIGHT.direction.tobytes()
    assert (light.strength, light.table_brightness) == (1.0, 1.0)
    turned = light_of(Conditions(light_azimuth_deg=45.0001))
    assert np.allclose(turned.direction, LIGHT, atol=1e-4)


@pytest.mark.parametrize("key", ALL, ids=lambda key: key.name)
def test_a_setting_survives_a_recorded_simulation(key: Key) -> None:
    config = SimConfig(robot="hanger", cloth="napkin", **{key.name: another(key)})
    spec = config.environment_spec()
    recorded = json.loads(json.dumps(dict(spec.config)))
    assert changed({**recorded, "step_s": spec.step_s}) == {key.name: another(key)}
    assert changed(vars(config)) == {key.name: another(key)}
    cloth = recorded_cloth(spec.cloth, recorded)
    own = {name: value for name, value in recorded.items() if not name.startswith("cloth_")} | {"step_s": spec.step_s}
    again = SimConfig(robot="hanger", cloth=cloth.name, own_cloth=cloth, **own)
    assert again == config
    assert recorded_spec(spec.cloth, recorded) == config.cloth_spec
    size = recorded_size(spec.cloth, recorded_settings(recorded, spec.cloth_shape))
    assert size is not None
    assert (size.length_m, size.width_m) == pytest.approx((config.cloth_spec.length_m, config.cloth_spec.width_m))


def test_a_cloth_of_a_file_is_recorded_without_the_conditions_and_simulated_with_them(tmp_path) -> None:
    text = 'schema = 1\nname = "rag"\nlength_m = 0.3\nwidth_m = 0.2\nmass_kg = 0.02\n[mesh]\nrows = 7\ncolumns = 5\n'
    text += "elastic_n_m = 30.0\ndamping_n_s_m = 0.1\nbending_n_m = 0.4\nrate_hz = 240.0\n"
    (tmp_path / "rag.toml").write_text(text)
    config = SimConfig(robot="pickers", cloth=str(tmp_path / "rag.toml"), mass_factor=2.0, size_factor=0.5)
    assert config.cloth_spec.mass_kg == pytest.approx(0.02 * 2 * 0.25)
    assert (config.cloth_spec.length_m, config.cloth_spec.width_m) == (0.15, 0.1)
    spec = config.environment_spec()
    recorded = recorded_settings(spec.config, spec.cloth_shape)
    assert (recorded["cloth_mass_kg"], recorded["cloth_length_m"]) == (0.02, 0.3)
    assert config.under({"mass_factor": 1.0}).cloth_spec.mass_kg == pytest.approx(0.02 * 0.25)
    cloth = recorded_cloth("rag", recorded)
    settings = {name: value for name, value in recorded.items() if not name.startswith("cloth_")}
    assert SimConfig(robot="pickers", cloth="rag", own_cloth=cloth, **settings) == config


# What each key changes


def watch(**settings: Any) -> dict[str, bytes]:
    """Run a moment in the air, where the same process repeats itself to the bit; return what can be seen of it."""
    config = SimConfig(robot="hanger", cloth="napkin", start="hanging-quick", **settings)
    env = ClothSimulation(config)
    try:
        env.reset(1)
        env.observe()
        for _ in range(4):
            env.step(np.array([0.01, -0.005]))
            seen = env.observe()
        nodes = env.ground_truth().nodes
    finally:
        env.close()
    values = (nodes, seen.corner_positions, seen.rgb, seen.depth, np.array(seen.time_s))
    return {name: np.ascontiguousarray(value).tobytes() for name, value in zip(SEEN, values, strict=True)}


MOVES, PICTURE = {"nodes", "corners", "rgb", "depth"}, {"rgb", "depth"}
CLOTH = {"nodes", "corners", "rgb", "depth"}
CHANGES: Mapping[str, set[str]] = {
    "mass_factor": CLOTH,
    "stiffness_factor": CLOTH,
    "bending_factor": CLOTH,
    "size_factor": CLOTH,
    "hanger_width": CLOTH,
    "control": MOVES,
    "arm_stiffness_n_m": MOVES,
    "step_s": {*MOVES, "time"},
    "observation_latency_steps": {"corners", *PICTURE},
    "action_latency_steps": MOVES,
    **{f"camera_{name}": PICTURE for name in ("x_m", "y_m", "z_m", "tilt_deg", "width_px")},
    **{f"light_{name}": {"rgb"} for name in ("azimuth_deg", "height_deg", "strength")},
    "depth_noise": {"depth"},
}
ON_THE_TABLE = {"table_friction", "friction_factor"}


@pytest.fixture(scope="module")
def usual() -> dict[str, bytes]:
    return watch()


def test_every_key_is_tried() -> None:
    assert {*CHANGES, *ON_THE_TABLE} == {*keys()} == {item.name for item in fields(Conditions)}


@pytest.mark.parametrize("name", CHANGES)
def test_a_key_changes_what_it_says_and_nothing_else(name: str, usual: dict[str, bytes]) -> None:
    now = watch(**{name: another(key_of(name))})
    assert {part for part in SEEN if now[part] != usual[part]} == CHANGES[name]


@pytest.mark.parametrize("name", sorted(ON_THE_TABLE))
def test_friction_holds_the_cloth(name: str) -> None:
    def slipped(factor: float) -> float:
        config = SimConfig(robot="pickers", cloth="napkin", start="hanging-quick", camera=False, **{name: factor})
        env = ClothSimulation(config)
        env.reset(3)
        edge = slice(config.cloth_spec.columns)
        while env.ground_truth().nodes[edge, 2].min() > 0.006:
            env.step(np.tile([0.0, 0.0, -0.015], 2))
        before = env.ground_truth().nodes[edge, 0].mean()
        for _ in range(5):
            env.step(np.tile([0.01, 0.0, -0.006], 2))
        after = env.ground_truth().nodes[edge, 0].mean()
        env.close()
        return float(after - before)

    assert slipped(0.1) > slipped(4.0) + 0.005


def test_latency_delays_by_whole_steps() -> None:
    def track(**settings: int) -> list[np.ndarray]:
        env = ClothSimulation(SimConfig(robot="pickers", start="hanging-quick", camera=False, **settings))
        env.reset(2)
        seen = [env.observe()]
        for k in range(6):
            env.step(np.tile([0.002 * k, 0.0, 0.0], 2))
            seen.append(env.observe())
        env.close()
        assert [round(each.time_s, 6) for each in seen] == [round(0.1 * k, 6) for k in range(7)]
        return [each.corner_positions for each in seen]

    now, late, acting_late = track(), track(observation_latency_steps=2), track(action_latency_steps=2)
    assert np.array_equal(late[2:], now[:-2])
    assert np.array_equal(late[0], late[1])
    moved = np.diff(np.array([each[0, 0] for each in acting_late]))
    assert moved == pytest.approx([0.0, 0.0, 0.0, 0.002, 0.004, 0.006], abs=1e-9)


def test_a_camera_that_has_moved_still_sees_the_cloth_where_it_is() -> None:
    seen = []
    for settings in ({}, {"camera_x_m": 0.1, "camera_z_m": -0.1}, {"camera_tilt_deg": 4.0}, {"camera_width_px": 640}):
        env = ClothSimulation(
            SimConfig(robot="pickers", cloth="napkin", start="hanging-quick", noise=False, **settings)
        )
        env.reset(1)
        assert env.spec.camera is not None
        assert env.spec.camera.cam_to_world.tobytes() == env.pinhole.cam_to_world.tobytes()
        picture = env.camera.capture(env.config.cloth_spec.flat_nodes(x_m=0.1))
        seen.append(PerceptionPipeline(env.pinhole).perceive(*picture).cloth_pixels)
        env.close()
    assert seen[1:] == pytest.approx([seen[0]] * 3, rel=0.03)
    up = pinhole_of(Conditions(camera_tilt_deg=5.0)).cam_to_world[:3, 2] - default_pinhole().cam_to_world[:3, 2]
    assert up[2] > 0.05


def test_python_and_gymnasium_take_the_keys_as_arguments_and_name_the_nearest_one() -> None:
    env = gymnasium.make(
        "layflat:layflat/ClothPlace-v0", robot="pickers", images=True, camera_width_px=160, mass_factor=2
    )
    assert env.observation_space["rgb"].shape == (120, 160, 3)  # type: ignore[index]
    assert env.unwrapped.simulation.config.mass_factor == 2.0  # type: ignore[attr-defined]
    assert layflat.make_env("hanger", camera_tilt_deg=2.0).pinhole.position[2] == default_pinhole().position[2]
    for make in (layflat.make_env, ClothPlaceEnv):
        with pytest.raises(SimError, match=r"unknown setting 'mass_facter'; did you mean mass_factor\?"):
            make("hanger", mass_facter=2.0)
        with pytest.raises(SimError, match=r"mass_factor is 9\.0; it must be a number between 0\.3 and 4"):
            make("hanger", mass_factor=9.0)
