"""Layflat's environment for robomimic: rollouts while it trains, playback, observations from states.

``python -m layflat.app.integrations.robomimic SCRIPT ...`` runs ``robomimic.scripts.SCRIPT`` with it: ``train``,
``run_trained_agent``, ``playback_dataset``, ``dataset_states_to_obs``. A program of one's own calls `register` first.
robomimic itself takes an environment of type gym for one of the old package ``gym``.
"""

from __future__ import annotations

import json
import runpy
import sys
from itertools import pairwise
from typing import Any

import h5py
import numpy as np
import robomimic.envs.env_base as env_base
import robomimic.utils.env_utils as env_utils
import robomimic.utils.obs_utils as obs_utils

from layflat import __version__
from layflat.app.support.errors import UsageError
from layflat.data.format import schema
from layflat.data.types import ACTION_LIMIT_M
from layflat.sim.env import ClothPlaceEnv
from layflat.sim.errors import SimError, look_up
from layflat.sim.tasks import DEFAULT_TASK, TASKS

IMAGES = {schema.RGB: "rgb", schema.DEPTH: "depth"}
"""robomimic's modality of each image; all other observations are ``low_dim``."""
_resolve = env_utils.get_env_class


class LayflatEnv(env_base.EnvBase):  # type: ignore[misc]  # untyped
    """`layflat.sim.env.ClothPlaceEnv` as robomimic's EnvBase.

    A recorded state is reached by running the actions of its episode again from the episode's seed: a cloth has more
    state than its nodes. `know` names the data sets whose states can be reached.
    """

    recordings: dict[bytes, tuple[str, str, int]] = {}  # noqa: RUF012  # shared by all environments on purpose
    """File, demo and step of each known state, by its bytes."""

    def __init__(
        self,
        env_name: str,
        render: bool = False,
        render_offscreen: bool = False,
        use_image_obs: bool = False,
        postprocess_visual_obs: bool = True,
        **kwargs: Any,
    ) -> None:
        if not env_name.startswith("layflat/"):
            raise UsageError(f"environment {env_name} is not one of Layflat's; run robomimic's own script for it")
        self._name, self._kwargs, self._postprocess = env_name, kwargs, postprocess_visual_obs
        # Episodes were recorded from the program's start, which a replay needs to the bit.
        start = look_up("task", kwargs.get("task", DEFAULT_TASK), TASKS).starts[0]
        self.env = ClothPlaceEnv(**{"start": start} | kwargs, images=use_image_obs, render_mode="rgb_array")
        self._at: tuple[str, str, int] | None = None

    @classmethod
    def know(cls, path: str) -> None:
        """Make the states of a data set known to `reset_to`."""
        with h5py.File(path, "r") as file:
            for name, demo in file[schema.DATA].items():
                for step, state in enumerate(demo[schema.STATES][()] if schema.STATES in demo else ()):
                    cls.recordings.setdefault(state.tobytes(), (path, name, step))

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, dict[str, Any]]:
        """Do an action, (A,) in shares of the limit."""
        self._observation, self._reward, self._done, _, self._info = self.env.step(action)
        self._at = None
        return self.get_observation(), self._reward, self._done, self._info

    def reset(self) -> dict[str, Any]:
        """Start an episode whose seed comes from numpy's global state, which robomimic seeds."""
        return self._start(int(np.random.randint(2**31)))  # noqa: NPY002

    def _start(self, seed: int) -> dict[str, Any]:
        self._observation, self._info = self.env.reset(seed=seed)
        self._reward, self._done, self._at = 0.0, False, None
        return self.get_observation()

    def reset_to(self, state: dict[str, Any]) -> dict[str, Any]:
        """Bring about the state of now, or one of a known recording."""
        place = self.recordings.get(np.asarray(state["states"], dtype="<f8").tobytes())
        if place is None and np.array_equal(state["states"], self.get_state()["states"]):
            return self.get_observation()
        if place is None:
            raise UsageError("this state is not of a known recording; call LayflatEnv.know(data set) first")
        path, name, step = place
        with h5py.File(path, "r") as file:
            demo = file[schema.DATA][name]
            if len(json.loads(demo.attrs[schema.DISTURBANCES])) or schema.DRAG_NODE in demo:
                raise UsageError(f"{name} of {path} was disturbed; only its observations can be played back")
            actions, seed = demo[schema.ACTION_M][:step] / ACTION_LIMIT_M, int(demo.attrs[schema.SEED])
        begun = self._at[2] if self._at is not None and self._at[:2] == (path, name) and self._at[2] <= step else None
        if begun is None:
            self._start(seed)
        for action in actions[begun or 0 :]:
            self.step(action)
        self._at = place
        return self.get_observation()

    def render(
        self, mode: str = "human", height: int | None = None, width: int | None = None, camera_name: str = "", **_: Any
    ) -> Any:
        """Return an image for people; the camera's name is ignored."""
        if mode != "rgb_array":
            raise UsageError("robomimic's own window is not supported; give --video_path")
        return self.env.simulation.camera.render(width or 640, height or 480)

    def get_observation(self, di: Any = None) -> dict[str, Any]:
        """Return the observation now, images as robomimic's encoders take them."""
        found = dict(self._observation if di is None else di)
        for key in IMAGES.keys() & found.keys() if self._postprocess else ():
            if obs_utils.OBS_KEYS_TO_MODALITIES and key in obs_utils.OBS_KEYS_TO_MODALITIES:
                found[key] = obs_utils.process_obs(obs=found[key], obs_key=key)
        return found

    def get_state(self) -> dict[str, Any]:
        """Return the cloth's nodes."""
        return {"states": self.env.simulation.ground_truth().nodes.ravel()}

    def get_reward(self) -> float:
        """Return the gain of contact in the last step."""
        return self._reward

    def get_goal(self) -> Any:
        """Refuse: there are no goals."""
        raise NotImplementedError

    def set_goal(self, **kwargs: Any) -> None:
        """Refuse: there are no goals."""
        raise NotImplementedError

    def is_done(self) -> bool:
        """Whether the cloth has diverged."""
        return self._done

    def is_success(self) -> dict[str, bool]:
        """Return whether the cloth lies flat now."""
        return {"task": bool(self._info["is_success"])}

    @property
    def action_dimension(self) -> int:
        """Number of components of an action."""
        return self.env.simulation.spec.robot.size

    @property
    def name(self) -> str:
        """Name of the environment, as robomimic puts it into the names of files."""
        return self._name.replace("/", "-")

    @property
    def type(self) -> int:
        """Robomimic's type of gym environments."""
        return int(env_base.EnvType.GYM_TYPE)

    @property
    def version(self) -> str:
        """Version of Layflat."""
        return __version__

    def serialize(self) -> dict[str, Any]:
        """Return what data sets say about their environment."""
        return {
            "env_name": self._name, "type": self.type, "env_version": self.version, "env_kwargs": dict(self._kwargs)
        }  # fmt: skip

    @classmethod
    def create_for_data_processing(
        cls,
        env_name: str,
        camera_names: list[str],
        camera_height: int,
        camera_width: int,
        reward_shaping: bool,
        **kwargs: Any,
    ) -> LayflatEnv:
        """Make an environment that gives observations for files; any camera name asks for images, of their own size."""
        low_dim = [field.key for field in schema.OBSERVATION_FIELDS if not field.optional]
        spec = {"low_dim": low_dim, **{modality: [key] for key, modality in IMAGES.items()}}
        obs_utils.initialize_obs_utils_with_obs_specs({"obs": spec})
        return cls(env_name, use_image_obs=bool(camera_names), postprocess_visual_obs=False, **kwargs)

    @property
    def rollout_exceptions(self) -> tuple[Any, ...]:
        """Errors that end a rollout and not the training."""
        return (SimError,)

    def __repr__(self) -> str:
        return f"{self._name}\n{json.dumps(self._kwargs, sort_keys=True, indent=4)}"


def register() -> None:
    """Make robomimic use `LayflatEnv` for environments of type gym, in this process."""

    def get_env_class(env_meta: Any = None, env_type: Any = None, env: Any = None) -> Any:
        kind = env_utils.get_env_type(env_meta=env_meta, env_type=env_type, env=env)
        return LayflatEnv if kind == env_base.EnvType.GYM_TYPE else _resolve(env_type=kind)

    env_utils.get_env_class = get_env_class


def main(arguments: list[str]) -> None:
    """Run a script of robomimic with Layflat's environment."""
    if not arguments:
        raise SystemExit("usage: python -m layflat.app.integrations.robomimic SCRIPT [OPTION...]")
    register()
    for option, value in pairwise(arguments):
        if option == "--dataset":
            LayflatEnv.know(value)
    sys.argv = arguments
    runpy.run_module(f"robomimic.scripts.{arguments[0]}", run_name="__main__")


if __name__ == "__main__":
    main(sys.argv[1:])
