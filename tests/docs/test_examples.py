"""The examples for other programs run as the documentation prints them; skipped where a program is missing.

imitation shares no environment with Layflat: LAYFLAT_IMITATION_PYTHON names a Python that has it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

import pytest

from layflat.data import open_session
from layflat.data.exchange.csv_export import export_csv
from layflat.data.exchange.robomimic import export_robomimic
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.sim.env import ClothPlaceEnv
from layflat.tests.factories import make_episode, write_session
from layflat.tests.fake_environment import FakeEnvironment

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"


def _run(*command: object, python: str = sys.executable) -> str:
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT.parent)}
    words = [python, *map(str, command)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=240, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def _needs(module: str) -> None:
    if find_spec(module) is None:
        pytest.skip(f"{module} is not installed")


@pytest.fixture
def session(tmp_path):
    with open_session(write_session(tmp_path / "s.h5", [make_episode(n_steps=40, seed=i) for i in range(3)])) as opened:
        yield opened


def test_no_example_is_longer_than_a_page():
    paths = [path for path in EXAMPLES.iterdir() if path.suffix in (".py", ".json")]
    assert len(paths) >= 3
    assert all(len(path.read_text().splitlines()) <= 65 for path in paths if "lerobot" not in path.name)


def test_imitation_learns_from_a_csv_export(session, tmp_path):
    if (python := os.environ.get("LAYFLAT_IMITATION_PYTHON")) is None:
        pytest.skip("LAYFLAT_IMITATION_PYTHON names no Python with imitation")
    export_csv(session, tmp_path / "tables")
    printed = _run(EXAMPLES / "imitation_bc.py", tmp_path / "tables", tmp_path / "bc.pt", "--epochs", 1, python=python)
    assert printed.splitlines()[-1].startswith("120 steps; the mean error of an action is")
    assert (tmp_path / "bc.pt").stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_stable_baselines_learns_in_the_environment(tmp_path):
    _needs("stable_baselines3")
    options = ("--steps", 32, "--envs", 1, "--rollout", 16, "--out", tmp_path / "ppo.zip")
    assert "a policy that lays the towel flat earns 1" in _run(EXAMPLES / "stable_baselines3_ppo.py", *options)


@pytest.mark.parametrize("images", [False, True])
def test_stable_baselines_checker_asks_for_nothing_but_depth_as_bytes(images):
    _needs("stable_baselines3")
    from stable_baselines3.common.env_checker import check_env

    env = ClothPlaceEnv("pickers", cloth="napkin", images=images)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        check_env(env)
    env.close()
    assert len(heard) <= 2 * images
    assert all("depth is an image" in str(warning.message) for warning in heard)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_robomimic_trains_and_rolls_out(session, tmp_path):
    _needs("robomimic")
    export_robomimic(session, tmp_path / "rm.hdf5", valid_share=0.3, seed=0)
    config = json.loads((EXAMPLES / "robomimic_bc.json").read_text())
    config["train"] |= {"output_dir": str(tmp_path / "trained"), "num_epochs": 1, "data": str(tmp_path / "rm.hdf5")}
    config["experiment"] |= {"epoch_every_n_steps": 3, "validation_epoch_every_n_steps": 1, "render_video": False}
    config["experiment"]["rollout"] |= {"n": 1, "horizon": 5, "rate": 1}
    (tmp_path / "bc.json").write_text(json.dumps(config))
    printed = _run("-m", "layflat.app.integrations.robomimic", "train", "--config", tmp_path / "bc.json")
    assert "finished run successfully!" in printed
    assert '"Horizon": 5.0' in printed


def test_the_robomimic_environment_reaches_recorded_states(tmp_path):
    """In its first episode to the bit; a state that it does not know, or of a disturbed episode, is refused."""
    _needs("robomimic")
    printed = _run("-c", REACHES, tmp_path)
    assert printed.splitlines()[-1] == "True True refused"


REACHES = """
import sys
from pathlib import Path
import numpy as np
import layflat
from layflat.app.integrations.robomimic import LayflatEnv, env_utils, register
from layflat.data import SessionRecorder
from layflat.data.session.edited_demo import trimmed
from layflat.app.support.errors import UsageError
env = layflat.make_env(robot="pickers", cloth="napkin")
episode = trimmed(layflat.rollout(env, layflat.load_policy("scripted"), seed=3), 0, 4)
path = Path(sys.argv[1]) / "s.h5"
with SessionRecorder(path, robot=env.spec.robot, cloth="napkin") as recorder:
    recorder.save(episode)
env.close()
register()
LayflatEnv.know(str(path))
import json, h5py
meta = json.loads(h5py.File(path)["data"].attrs["env_args"])
mine = env_utils.create_env_from_metadata(env_meta=meta)
states = [step.ground_truth.nodes.ravel() for step in episode.steps]
seen = mine.reset_to({"states": states[2]})
same = np.array_equal(mine.get_state()["states"], states[2])
step = episode.steps[2].observation
near = all(np.allclose(seen[key], np.ravel(getattr(step, key)), atol=1e-6) for key in ("corner_positions", "word"))
try:
    mine.reset_to({"states": states[2] + 1})
except UsageError:
    print(same, near, "refused")
"""


def test_a_torch_net_learns_from_a_session_and_acts(tmp_path, monkeypatch):
    _needs("torch")
    write_session(tmp_path / "demos.h5", [make_episode(n_steps=40, seed=i) for i in range(3)])
    assert "120 steps; the error" in _run(EXAMPLES / "torch_bc.py", tmp_path / "demos.h5", tmp_path / "net.pt", 20)
    monkeypatch.setenv("TORCH_BC", str(tmp_path / "net.pt"))
    monkeypatch.chdir(EXAMPLES)
    episode = rollout(
        FakeEnvironment(SimConfig(robot="hanger")), PolicySpec.parse("torch_bc:NetPolicy"), seed=0, max_steps=3
    )
    assert len(episode.steps) == 3
