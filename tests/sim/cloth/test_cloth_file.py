"""Cloth files: read, refused in a sentence, written back, named by file and known by name."""

from __future__ import annotations

from dataclasses import replace

import pytest

from layflat.sim.cloth.cloth_file import ClothMesh, read_cloth, write_mesh
from layflat.sim.cloth.registry import CLOTHS, cloth_settings, cloth_spec, recorded_cloth
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError

FABRIC = """# My cloth.
schema = 1
name = "tea-towel"
length_m = 0.26            # free edge to held edge
width_m = 0.3
mass_kg = 0.028
hanging_stretch = 0.012
bending_length_m = 0.022
friction = 0.4
"""
MESH = """
[mesh]
rows = 11
columns = 12
elastic_n_m = 30
damping_n_s_m = 0.1
bending_n_m = 0.5
rate_hz = 200
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "tea.toml"
    path.write_text(FABRIC + MESH)
    return path


def test_a_file_gives_a_cloth_wherever_a_name_does(file):
    spec = cloth_spec(str(file))
    assert (spec.name, spec.length_m, spec.width_m, spec.friction) == ("tea-towel", 0.26, 0.3, 0.4)
    assert (spec.rows, spec.columns, spec.elastic_n_m, spec.rate_hz) == (11, 12, 30.0, 200.0)
    config = SimConfig(robot="hanger", cloth=str(file))
    assert (config.cloth, config.cloth_spec, config.own_cloth) == ("tea-towel", spec, spec)
    assert replace(config, robot="pickers").cloth_spec == spec


def test_a_recorded_cloth_is_the_same_without_its_file(file):
    spec = cloth_spec(str(file))
    settings = SimConfig(robot="hanger", cloth=str(file)).environment_spec().config
    assert recorded_cloth("tea-towel", settings) == spec
    assert SimConfig(robot="hanger", cloth="tea-towel", own_cloth=spec).environment_spec().config == settings


@pytest.mark.parametrize("name", CLOTHS)
def test_a_preset_is_recorded_by_its_name(name):
    settings = SimConfig(robot="pickers", cloth=name).environment_spec().config
    assert not cloth_settings(CLOTHS[name])
    assert not any(key.startswith("cloth_") for key in settings)
    size = {"cloth_length_m": 0.3, "cloth_width_m": 0.3}  # which an episode adds
    assert recorded_cloth(name, settings | size) == CLOTHS[name]
    assert recorded_cloth(name, settings) == CLOTHS[name]


def test_settings_that_lack_a_part_of_the_cloth_are_refused(file):
    settings = dict(SimConfig(robot="hanger", cloth=str(file)).environment_spec().config)
    settings.pop("cloth_rows")
    with pytest.raises(SimError, match="cloth tea-towel are incomplete: 'rows'"):
        recorded_cloth("tea-towel", settings)


def test_a_fitted_mesh_is_written_behind_everything_else(tmp_path):
    path = tmp_path / "tea.toml"
    path.write_text(FABRIC)
    with pytest.raises(SimError, match=r"has no \[mesh\] yet; `layflat cloth fit"):
        cloth_spec(str(path))
    mesh = ClothMesh(rows=9, columns=10, elastic_n_m=12.5, damping_n_s_m=0.1, bending_n_m=0.2, rate_hz=220.0)
    for fitted in (mesh, replace(mesh, rows=8)):
        write_mesh(path, fitted)
        assert read_cloth(path).mesh == fitted
        assert path.read_text().startswith(FABRIC.rstrip())
        assert path.read_text().count("[mesh]") == 1


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("schema = 1", "schema = 2", "schema is 2; it must be 1"),
        ("length_m = 0.26", "lenght_m = 0.26", "unknown key 'lenght_m'; did you mean length_m\\?"),
        ("length_m = 0.26", "length_m = 0.9", "length_m is 0.9; it must be a number from 0.15 to 0.6"),
        ("mass_kg = 0.028", "mass_kg = nan", "mass_kg is nan"),
        ("mass_kg = 0.028", "mass_kg = true", "mass_kg is True"),
        ("mass_kg = 0.028", "", "mass_kg is missing"),
        ("rows = 11", "rows = 11.5", "rows is 11.5; it must be a whole number from 2 to 40"),
        ("rows = 11", "", "rows is missing"),
        ('name = "tea-towel"', 'name = "Tea towel"', "use small letters, digits and single hyphens"),
        ('name = "tea-towel"', "name = 3", "name is 3; it must be text"),
        ('name = "tea-towel"', 'name = "towel"', "the name towel is that of a preset"),
        ("[mesh]", "mesh = 3\n[other]", "mesh must be a table"),
        ("[mesh]", "[mesh", "is not TOML"),
        ("damping_n_s_m = 0.1", "damping_n_s_m = 0.01", "it explodes"),
        ("hanging_stretch = 0.012", "hanging_stretch = 0.5", "from 0.001 to 0.05"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_sentence(file, old, new, words):
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(SimError, match=words) as caught:
        cloth_spec(str(file))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(SimError, match="cannot be read: No such file"):
        cloth_spec(str(tmp_path / "no.toml"))
    (tmp_path / "long.toml").write_bytes(b"#" * 200_000)
    with pytest.raises(SimError, match="longer than 100 kB"):
        cloth_spec(str(tmp_path / "long.toml"))
    (tmp_path / "latin.toml").write_bytes(b'name = "\xff"')
    with pytest.raises(SimError, match="is not TOML"):
        cloth_spec(str(tmp_path / "latin.toml"))
