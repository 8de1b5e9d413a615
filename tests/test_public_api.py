"""`import layflat`: the public API, and what is importable from an installed Layflat."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import layflat
from layflat.policy.base import PolicyError
from layflat.sim.errors import SimError

CALL = """
import sys
import layflat
loaded = {"numpy", "h5py", "cv2", "pybullet", "gymnasium", "scipy"} & set(sys.modules)
assert not loaded, f"import layflat imports {loaded}"
import gymnasium
env = gymnasium.make("layflat:layflat/ClothPlace-v0", robot="pickers", cloth="napkin")
observation, info = env.reset(seed=3)
env.step(env.action_space.sample())
"""


class Lower:
    """A policy of one's own: moves down, and returns the bare action."""

    name = "lower"

    def __init__(self, robot: layflat.RobotSpec) -> None:
        self.robot = robot

    def reset(self, seed: int) -> None:
        """Forget nothing."""

    def act(self, observation: layflat.Observation) -> np.ndarray:
        return self.robot.pack([0.0, 0.0, -0.01])


def test_every_public_name_is_there_and_documented():
    for name in layflat.__all__:
        assert getattr(layflat, name) is not None
        assert name == "__version__" or (getattr(layflat, name).__doc__ or "").strip()
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        layflat.nothing  # noqa: B018


def test_a_policy_of_ones_own_is_rolled_out():
    env = layflat.make_env(robot="pickers", cloth="napkin")
    episode = layflat.rollout(env, Lower(env.spec.robot), seed=7, max_steps=4)
    env.close()
    heights = [observation.holder_position[2] for observation in episode.observations()]
    np.testing.assert_allclose(np.diff(heights), -0.01, atol=2e-3)
    assert (episode.source, len(episode.steps), episode.stopped_by) == ("lower", 4, "step_limit")
    assert 0.0 <= episode.contact_final <= 1.0
    assert episode.flat_area_final is not None


def test_a_policy_text_is_rolled_out():
    env = layflat.make_env()
    episode = layflat.rollout(env, layflat.load_policy("hold+steady"), seed=1, max_steps=3)
    env.close()
    assert episode.robot.name == "hanger"


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: layflat.make_env(robot="crane"), SimError, "crane.*hanger, pickers"),
        (lambda: layflat.make_env(cloth="silk"), SimError, "silk.*towel"),
        (lambda: layflat.make_env(task="iron"), SimError, "iron.*place"),
        (lambda: layflat.make_env(physics="ideal"), SimError, "ideal.*bullet"),
        (lambda: layflat.load_policy("missing.npz"), PolicyError, "missing.npz does not exist"),
        (lambda: layflat.load_policy("genius"), PolicyError, "genius.*scripted"),
    ],
)
def test_an_unknown_name_is_refused_with_the_known_ones(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_it_works_in_a_folder_with_packages_of_the_same_names(tmp_path):
    for name in ("app", "data", "sim", "policy", "perception"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong package')\n")
    done = subprocess.run([sys.executable, "-c", CALL], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def test_a_wheel_contains_layflat_alone(tmp_path):
    pyproject = Path(layflat.__file__).parent / "pyproject.toml"
    listed = pyproject.read_text(encoding="utf-8").split("packages = [")[1].split("]")[0]
    packages = {word.strip(' ",') for word in listed.splitlines() if word.strip()}
    root = pyproject.parent
    folders = {
        ".".join(("layflat", *init.parent.relative_to(root).parts))
        for top in ("app", "data", "perception", "policy", "sim")
        for init in (root / top).rglob("__init__.py")
    }
    assert packages == {"layflat", *folders}
