"""Variations: what a seed draws, and what a file may say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from layflat.sim.conditions.keys import keys
from layflat.sim.conditions.variation import Draw, Variation, shipped, variation
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError


def written(folder: Path, lines: str, head: str = "schema = 1\n[draw]\n") -> str:
    path = folder / "own.toml"
    path.write_text(head + lines)
    return str(path)


def test_what_ships_is_what_the_manual_names() -> None:
    assert shipped() == ("all", "camera", "cloths", "contact", "light")
    parts = [variation([name]).described() for name in ("cloths", "camera", "light", "contact")]
    assert variation(["all"]).described() == {key: law for part in parts for key, law in part.items()}


@pytest.mark.parametrize("robot", ["hanger", "pickers"])
@pytest.mark.parametrize("name", shipped())
def test_every_draw_is_a_possible_simulation_and_within_its_range(name: str, robot: str) -> None:
    drawn = variation([name])
    usual = SimConfig(robot=robot)
    for seed in range(60):
        sample = drawn.sample(seed)
        assert [*sample] == [draw.key for draw in drawn.draws]
        usual.under(sample)
        for draw in drawn.draws:
            low, high = min(draw.values), max(draw.values)
            assert low <= sample[draw.key] <= high


def test_a_seed_draws_the_same_whatever_else_is_drawn() -> None:
    alone, together = variation(["camera"]), variation(["light", "camera"])
    for seed in (0, 7, 2**32 - 1):
        assert alone.sample(seed).items() <= together.sample(seed).items()
    assert alone.sample(1) != alone.sample(2)
    values = np.array([list(alone.sample(seed).values()) for seed in range(400)], dtype=float)
    assert np.abs(np.corrcoef(values.T) - np.eye(values.shape[1])).max() < 0.2


def test_the_laws_are_the_ones_that_are_asked_for() -> None:
    def drawn(draw: Draw) -> np.ndarray:
        return np.array([draw.sample(seed) for seed in range(600)], dtype=float)

    assert np.mean(drawn(Draw("mass_factor", "uniform", (0.5, 2.0)))) == pytest.approx(1.25, abs=0.06)
    assert np.median(drawn(Draw("mass_factor", "log_uniform", (0.5, 2.0)))) == pytest.approx(1.0, abs=0.08)
    whole = drawn(Draw("action_latency_steps", "uniform", (0, 2)))
    assert {*whole} == {0, 1, 2}
    assert np.bincount(whole.astype(int)) == pytest.approx([200] * 3, rel=0.2)
    assert all(
        isinstance(Draw("camera_width_px", law, (160, 640)).sample(3), int) for law in ("uniform", "log_uniform")
    )
    chosen = [Draw("control", "choice", ("impedance", "position")).sample(seed) for seed in range(600)]
    assert chosen.count("position") == pytest.approx(300, rel=0.2)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("mas_factor = { uniform = [0.5, 2.0] }", "unknown key 'mas_factor'; did you mean mass_factor"),
        ("mass_factor = { uniform = [2.0, 0.5] }", "runs from 2 to 0.5; give the lower value first"),
        ("mass_factor = { uniform = [1.0, 1.0] }", "runs from 1 to 1"),
        ("mass_factor = { uniform = [0.5, 20.0] }", "mass_factor is 20.0; it must be a number between 0.3 and 4"),
        ("mass_factor = { uniform = [0.5] }", "uniform of mass_factor is .*; it must be \\[low, high\\]"),
        ("mass_factor = { uniform = 'wide' }", "it must be \\[low, high\\]"),
        ("mass_factor = { normal = [0.5, 1.0] }", "it must be one of { uniform"),
        ("mass_factor = { uniform = [0.5, 1.0], choice = [1.0] }", "it must be one of"),
        ("mass_factor = 1.0", "mass_factor is 1.0; it must be one of"),
        ("mass_factor = { uniform = [0.5, 'b'] }", "mass_factor is 'b'; it must be a number"),
        ("mass_factor = { choice = [] }", "it must be a list of values"),
        ("depth_noise = { log_uniform = [0.0, 1.0] }", "begins at 0; it must begin above 0"),
        ("control = { uniform = ['impedance', 'position'] }", "use choice"),
        ("control = { choice = ['soft'] }", "control is 'soft'"),
        ("action_latency_steps = { uniform = [0, 1.5] }", "is 1.5; it must be a whole number"),
        ("step_s = { uniform = [0.05, 0.1] }", "cannot be drawn"),
        ("mass_factor = {", "is not TOML: "),
        ("", "there is no \\[draw\\]"),
    ],
)
def test_a_file_that_is_wrong_is_refused_in_one_sentence(tmp_path: Path, lines: str, message: str) -> None:
    with pytest.raises(SimError, match=message) as caught:
        variation([written(tmp_path, lines)])
    assert str(tmp_path / "own.toml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_input_that_is_wrong(tmp_path: Path) -> None:
    for head, message in (("schema = 2\n[draw]\n", "schema is 2"), ("schema = 1\nranges = 1\n", "'ranges' is unknown")):
        with pytest.raises(SimError, match=message):
            variation([written(tmp_path, "", head)])
    with pytest.raises(SimError, match="'clothes' is unknown; give one of all, camera"):
        variation(["clothes"])
    with pytest.raises(SimError, match="cannot be read: "):
        variation([str(tmp_path / "missing.toml")])
    with pytest.raises(SimError, match="mass_factor is drawn twice; give only one of cloths, all"):
        variation(["cloths", "all"])
    (tmp_path / "binary.toml").write_bytes(b"\xff\x00")
    with pytest.raises(SimError, match="is not TOML"):
        variation([str(tmp_path / "binary.toml")])


def test_a_name_given_twice_counts_once_and_nothing_draws_nothing() -> None:
    assert variation(["light", "light"]) == variation(["light"])
    assert variation([]).sample(1) == Variation().sample(1) == {}
    assert {draw.key for draw in variation(["all"]).draws} <= {*keys()}
