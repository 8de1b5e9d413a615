"""docs/examples/lerobot_*.py: LeRobot trains on an export by its own command, and its policies act in the environment.

Most tests need LeRobot: in this Python, or in the one that the environment variable LAYFLAT_LEROBOT_PYTHON names.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from websockets.sync.client import connect

from layflat.data.exchange.lerobot import TaskEpisodes, export_lerobot
from layflat.data.session.reader import open_session
from layflat.policy.foreign import wire
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.sim.env import ClothPlaceEnv
from layflat.tests.factories import make_episode, write_session
from layflat.tests.fake_environment import FakeEnvironment

pq = pytest.importorskip("pyarrow.parquet", reason="needs layflat[export]")

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
OWN = sys.executable if importlib.util.find_spec("lerobot") else None
PYTHONS = [python for python in (OWN, os.environ.get("LAYFLAT_LEROBOT_PYTHON")) if python]
needs_lerobot = pytest.mark.skipif(not PYTHONS, reason="needs LeRobot, here or in LAYFLAT_LEROBOT_PYTHON")
SMALL = {
    "act": "--policy.dim_model=32 --policy.n_heads=2 --policy.dim_feedforward=32 --policy.n_encoder_layers=1"
    " --policy.chunk_size=4 --policy.n_action_steps=2 --policy.use_vae=false"
    " --policy.pretrained_backbone_weights=null",
    "diffusion": "--policy.down_dims=[16,32] --policy.diffusion_step_embed_dim=16 --policy.horizon=8"
    " --policy.n_action_steps=4 --policy.drop_n_last_frames=0 --policy.num_train_timesteps=4",
}


def exported(folder: Path, *, images: bool = False) -> Path:
    """Return an export of four episodes."""
    made = [make_episode(seed=seed, n_steps=12, images=images) for seed in range(4)]
    with open_session(write_session(folder / "s.h5", made)) as session:
        source = TaskEpisodes(session=session, names=session.names, task_text="Lay the towel flat.")
        export_lerobot([source], folder / "lr")
    return folder / "lr"


def train(python: str, data: Path, out: Path, policy: str) -> Path:
    """Train two steps as a user would, and return the checkpoint."""
    command = [python, "-m", "lerobot.scripts.lerobot_train", "--dataset.repo_id=local/x", f"--dataset.root={data}"]
    command += [f"--output_dir={out}", f"--policy.type={policy}", *SMALL[policy].split(), "--policy.device=cpu"]
    command += ["--steps=2", "--save_freq=2", "--batch_size=4", "--num_workers=0", "--policy.push_to_hub=false"]
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(out.parent / "hf"), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=os.environ | offline, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return out / "checkpoints/last/pretrained_model"


@pytest.fixture(params=PYTHONS or [None])
def served(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The address of a server."""
    checkpoint = train(request.param, exported(tmp_path), tmp_path / "act", "act")
    command = [request.param, str(EXAMPLES / "lerobot_server.py"), str(checkpoint), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield next(line.strip() for line in server.stdout if line.startswith("ws"))
        server.terminate()


def test_the_environments_observation_has_the_exports_columns(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    server = importlib.import_module("lerobot_server")
    env = ClothPlaceEnv(images=True, noise=False)
    try:
        seen, _ = env.reset(seed=3)
        observation = env.simulation.observe(images=True)
    finally:
        env.close()
    episode = make_episode(n_steps=1, images=True)
    episode = replace(
        episode, steps=(replace(episode.steps[0], observation=observation),), final_observation=observation
    )
    with open_session(write_session(tmp_path / "s.h5", [episode])) as session:
        source = TaskEpisodes(session=session, names=session.names, task_text="Lay it flat.")
        export_lerobot([source], tmp_path / "lr")
    (row,) = pq.read_table(tmp_path / "lr/data").to_pylist()
    found = server.as_lerobot(seen)
    assert found.keys() == {key for key in row if key.startswith("observation.")}
    for key in ("observation.state", "observation.environment_state"):
        assert found[key].dtype == np.float32
        assert found[key].tolist() == row[key]


@needs_lerobot
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("policy", SMALL)
@pytest.mark.parametrize("python", PYTHONS)
def test_lerobot_trains_on_an_export_as_it_is(python, policy, tmp_path):
    assert train(python, exported(tmp_path), tmp_path / policy, policy).is_dir()


@needs_lerobot
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_served_policy_acts_and_a_fork_of_its_episode_too(served):
    env = FakeEnvironment(SimConfig(robot="hanger"))
    first = rollout(env, PolicySpec.parse(f"act={served}"), seed=3, disturbance="push", max_steps=6)
    again = rollout(env, PolicySpec.parse(f"act={served}"), seed=3, disturbance="push", max_steps=6)
    assert len(first.steps) > 6
    assert [step.action.tolist() for step in first.steps] == [step.action.tolist() for step in again.steps]


@needs_lerobot
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_message_that_is_no_observation_is_answered_in_words(served):
    with connect(served) as connection:
        connection.recv()
        connection.send(wire.pack({"step": 0, "resumed": False}))
        assert connection.recv() == "KeyError: 'corner_positions'"
