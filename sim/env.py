"""ClothPlaceEnv: the Gymnasium protocol on top of ClothSimulation.

The same seed and actions give the same bits in every fresh process. In a process that simulates a further episode the
start and the flight are still the same bits, but once cloth touches cloth the nodes may differ by millimetres, because
Bullet shuffles self-collision impulses with a seed that it never resets.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from layflat.data.format import schema
from layflat.data.types import ACTION_LIMIT_M
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import disturbance_spec
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import DEFAULT_ROBOT
from layflat.sim.simulation import ClothSimulation
from layflat.sim.tasks import DEFAULT_TASK

RENDER_SIZE = (640, 480)
DISTURB_STEP = 100

ObsDict = dict[str, NDArray[Any]]


class ClothPlaceEnv(gymnasium.Env[ObsDict, NDArray[np.float32]]):
    """Lay the cloth flat on the table, or smooth it.

    Parameters
    ----------
    robot, cloth, task
        Names; SimError lists the known ones.
    images
        Whether observations hold ``rgb`` and ``depth``.
    disturbance
        Name of a disturbance that starts at step ``disturb_step``.
    render_mode
        None or "rgb_array".
    **settings
        Further fields of `layflat.sim.config.SimConfig`, such as ``table_friction``, ``control`` and ``noise``.

    Notes
    -----
    Action: Box(-1, 1, (A,)), displacement of this step / ACTION_LIMIT_M in the order of the robot's axes; cut off at
    the limits. SimError for a wrong shape or a value that is not finite.

    Observation: what a policy may see, with the names, shapes and units of one row of ``obs`` in a session file
    (docs/reference/session-file.md): ``corner_positions`` (6,), ``depth`` (H, W, 1), numbers as (1,).

    Reward: gain of the camera's contact portion in this step, so that an episode's rewards add up to the portion at its
    end less that at its start. The flat area, which decides success, is in ``info`` and not in the reward: it is the
    simulator's knowledge.

    Terminated: the cloth has diverged; ``info["unstable"]`` says why, the observation is the last valid one, and the
    reward is 0. There is no other end: the policy decides when the cloth is flat (``info["is_success"]``).

    Info: contact_portion_true, flat_area, is_success, unstable ("" or why), seed (of the start).
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # gymnasium's own form

    def __init__(
        self,
        robot: str = DEFAULT_ROBOT,
        *,
        cloth: str = DEFAULT_CLOTH,
        task: str = DEFAULT_TASK,
        images: bool = False,
        disturbance: str | None = None,
        disturb_step: int = DISTURB_STEP,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SimError(f"render_mode is {render_mode!r}; it must be None or 'rgb_array'")
        if disturbance is not None:
            disturbance_spec(disturbance)
        self.render_mode = render_mode
        self.simulation = ClothSimulation(SimConfig(robot=robot, cloth=cloth, task=task, **settings))
        self._images = images
        self._disturbance, self._disturb_step = disturbance, disturb_step
        self._step_index = self._seed = 0
        self._size = self.simulation.spec.robot.size
        self._spaces = self._make_spaces()
        self.action_space = spaces.Box(-1.0, 1.0, (self._size,), np.float32)
        self.observation_space = spaces.Dict({**self._spaces})  # type: ignore[assignment]  # gymnasium types it Dict[Any]

    def _make_spaces(self) -> dict[str, spaces.Box[Any]]:
        pinhole = default_pinhole()
        sides = {"H": pinhole.height, "W": pinhole.width}
        sides |= {f"{side} of depth": length for side, length in sides.items()}
        boxes: dict[str, spaces.Box[Any]] = {}
        for field in schema.OBSERVATION_FIELDS:
            if self._images or not field.optional:
                shape = schema.row_shape(field, self.simulation.spec.robot, sides)
                low, high = schema.OBSERVATION_LIMITS[field.key]
                boxes[field.key] = spaces.Box(low, high, shape, np.dtype(field.dtype).type)
        return boxes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsDict, dict[str, Any]]:
        """Start the episode of ``seed``, the same as the program's; without one, of a random seed."""
        super().reset(seed=seed)
        self._seed = int(self.np_random.integers(2**31)) if seed is None else seed
        self.simulation.reset(self._seed)
        self._step_index = 0
        self._observation = self.simulation.observe(images=self._images)
        return self._as_dict(), self._info(None)

    def step(self, action: NDArray[np.float32]) -> tuple[ObsDict, float, bool, bool, dict[str, Any]]:
        """Move the robot in one control step."""
        values = np.asarray(action, dtype=float)
        if values.shape != (self._size,) or not np.isfinite(values).all():
            raise SimError(f"the action is {values.tolist()}; it must be {self._size} finite numbers")
        if self._step_index == self._disturb_step and self._disturbance is not None:
            self.simulation.disturb(self._disturbance)
        self._step_index += 1
        self.simulation.step(np.clip(values, -1.0, 1.0) * ACTION_LIMIT_M)
        reason = self.simulation.divergence_reason()
        if reason is not None:
            return self._as_dict(), 0.0, True, False, self._info(reason)
        before, self._observation = self._observation, self.simulation.observe(images=self._images)
        reward = self._observation.contact_portion - before.contact_portion
        return self._as_dict(), reward, False, False, self._info(None)

    def _as_dict(self) -> ObsDict:
        values = {
            name: np.asarray(getattr(self._observation, name)).reshape(b.shape) for name, b in self._spaces.items()
        }
        return {name: np.clip(values[name].astype(b.dtype), b.low, b.high) for name, b in self._spaces.items()}

    def _info(self, unstable: str | None) -> dict[str, Any]:
        info = {"unstable": unstable or "", "seed": self._seed}
        if unstable is not None:  # The mesh of a diverged cloth means nothing.
            return {"contact_portion_true": 0.0, "flat_area": 0.0, "is_success": False} | info
        ground_truth = self.simulation.ground_truth()
        areas = {"contact_portion_true": ground_truth.contact_portion_true, "flat_area": ground_truth.flat_area}
        return areas | {"is_success": self.simulation.config.task_spec.is_success(ground_truth)} | info

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Return an image for people, (480, 640, 3), or None without a render mode."""
        if self.render_mode is None:
            return None
        if self.simulation.world is None:
            raise SimError("there is nothing to render yet; call reset() first")
        return self.simulation.camera.render(*RENDER_SIZE)

    def close(self) -> None:
        """Free the simulation."""
        self.simulation.close()
