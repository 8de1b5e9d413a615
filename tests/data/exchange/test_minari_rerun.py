"""Minari reads the observations of the environment, to the bit; Rerun accepts every recording. Skipped without them."""

from __future__ import annotations

import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from layflat.data import CameraModel, open_session
from layflat.data.errors import DataError
from layflat.data.exchange.minari import export_minari
from layflat.data.exchange.optional_imports import require
from layflat.data.exchange.rerun import export_rerun
from layflat.data.format import schema
from layflat.tests.factories import ROBOT_SPECS, make_episode, without_ground_truth, write_session

POSE = np.array([[1.0, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, 0.9], [0, 0, 0, 1]])
CAMERA = CameraModel(width=8, height=6, fx=7.0, fy=7.5, cx=3.5, cy=2.5, cam_to_world=POSE)


@pytest.fixture
def session(tmp_path):
    episodes = [make_episode(n_steps=3 + i, seed=i, images=True, camera=CAMERA, mesh_shape=(4, 3)) for i in range(2)]
    with open_session(write_session(tmp_path / "s.h5", episodes)) as opened:
        yield opened


def _loaded(folder, name, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    return pytest.importorskip("minari").load_dataset(name)


def test_minari_reads_every_step(session, tmp_path, monkeypatch):
    pytest.importorskip("minari")
    seen = []
    name = export_minari(session, tmp_path / "out", on_episode=seen.append)
    monkeypatch.chdir(tmp_path)
    export_minari(session, Path("out"))  # Replaces the first.
    data = _loaded(tmp_path / "out", name, monkeypatch)
    assert (name, seen) == ("hanger-place-towel-v0", ["demo_0", "demo_1"])
    assert (data.total_episodes, data.total_steps) == (2, 7)
    for demo, episode in zip(session.names, data.iterate_episodes(), strict=True):
        for field in schema.OBSERVATION_FIELDS:
            rows = episode.observations[field.key]
            assert np.array_equal(rows[:-1], session.array(demo, f"obs/{field.key}").astype(rows.dtype))
            assert np.array_equal(rows[-1], session.array(demo, f"next_obs/{field.key}")[-1].astype(rows.dtype))
            assert data.observation_space[field.key].shape == rows.shape[1:]
        np.testing.assert_allclose(episode.actions, session.array(demo, "actions"), rtol=1e-6)
        assert np.array_equal(episode.rewards, session.array(demo, "rewards"))
        assert episode.truncations.tolist() == [False] * (len(episode.rewards) - 1) + [True]
        assert episode.infos["flat_area"].shape == (len(episode.rewards) + 1,)
    assert data.spec.env_spec.kwargs["cloth"] == "towel"


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_real_robot_has_no_environment_and_no_truth(robot, tmp_path, monkeypatch):
    pytest.importorskip("minari")
    path = write_session(tmp_path / "s.h5", [without_ground_truth(make_episode(robot))])
    with open_session(path) as session:
        data = _loaded(tmp_path / "out", export_minari(session, tmp_path / "out", images=False), monkeypatch)
    assert data.spec.env_spec is None
    assert schema.RGB not in data.observation_space.spaces


def test_rerun_accepts_every_recording(session, tmp_path):
    rerun = pytest.importorskip("rerun")
    assert export_rerun(session, tmp_path / "out") == 2
    for name in session.names:
        path = tmp_path / "out" / f"{name}.rrd"
        done = subprocess.run(["rerun", "rrd", "verify", path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        printed = subprocess.run(["rerun", "rrd", "print", path], capture_output=True, text=True, check=True).stdout
        for entity in ("/world/camera/rgb", "/world/camera/depth", "/world/cloth", "/world/word", "/curves/action/dx"):
            assert entity in printed
    assert rerun.__version__


def test_without_its_package_an_export_says_what_to_install(monkeypatch):
    for module, extra in (("minari", "minari"), ("rerun", "rerun"), ("pyarrow.parquet", "export")):
        if find_spec(module.partition(".")[0]) is None:
            with pytest.raises(DataError, match=rf"layflat\[{extra}\]"):
                require(module)
    with pytest.raises(DataError, match=r"layflat\[export\]"):
        require("no_such_module_anywhere")
