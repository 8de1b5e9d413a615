"""A cloth of the user's: recorded, replayed and drawn without its file; `layflat cloth` on wrong files."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from layflat.app.commands.cloth import ClothConfig, check, fit, list_cloths
from layflat.app.commands.replay import recorded_config
from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.support.errors import LayflatError, UsageError
from layflat.data import open_session
from layflat.sim.cloth.registry import CLOTHS
from layflat.tests.sim.cloth.test_cloth_file import FABRIC, MESH


def _layflat(folder, *words) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "layflat.app.cli.main", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240, check=False)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_session_carries_its_cloth_inside(tmp_path):
    (tmp_path / "tea.toml").write_text(FABRIC + MESH)
    recorded = _layflat(tmp_path, "record", "s.h5", "--cloth=tea.toml", "--episodes=1", "--workers=1")
    assert "kept demo_0 success" in recorded.stdout, recorded.stderr
    (tmp_path / "tea.toml").unlink()
    with open_session(tmp_path / "s.h5") as session:
        episode = session[0]
    spec = recorded_config(episode).cloth_spec
    assert (episode.cloth, spec.rows, spec.columns, spec.friction) == ("tea-towel", 11, 12, 0.4)
    with EpisodeRenderer() as renderer:
        assert len(renderer.frame_strip(episode, [0, len(episode.steps)], 200)) == 2
    replayed = _layflat(tmp_path, "replay", "s.h5", "--episode=0", "--mode=action", "--json=r.json")
    assert replayed.returncode == 0, replayed.stderr
    assert json.loads((tmp_path / "r.json").read_text())["identical"]


def test_the_list_has_every_preset(capsys):
    list_cloths()
    printed = capsys.readouterr().out
    assert all(name in printed for name in CLOTHS)


def test_a_file_with_a_mesh_is_not_fitted_again_unasked(tmp_path):
    path = tmp_path / "tea.toml"
    path.write_text(FABRIC + MESH)
    with pytest.raises(UsageError, match=r"has a \[mesh\] already; --force replaces it"):
        fit(ClothConfig(file=str(path)), force=False)
    assert path.read_text() == FABRIC + MESH


@pytest.mark.parametrize("command", [check, lambda config: fit(config, force=False)])
def test_what_is_no_cloth_is_one_sentence(command, tmp_path):
    with pytest.raises(UsageError, match="neither a cloth file"):
        command(ClothConfig(file="velvet"))
    with pytest.raises(UsageError, match="cannot be read"):
        command(ClothConfig(file=str(tmp_path / "no.toml")))


@pytest.mark.slow
def test_a_cloth_that_is_not_what_its_file_says_fails_the_check(tmp_path, capsys):
    path = tmp_path / "tea.toml"
    path.write_text((FABRIC + MESH).replace("bending_n_m = 0.5", "bending_n_m = 0.02"))
    with pytest.raises(LayflatError, match=r"its bending length is [\d.]+ mm, not 22.0 mm"):
        check(ClothConfig(file=str(path), json=tmp_path / "out.json"))
    assert json.loads((tmp_path / "out.json").read_text())["problems"]
    assert "hanging stretch" in capsys.readouterr().out
