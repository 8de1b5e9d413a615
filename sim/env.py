"""ClothPlaceEnv: the Gymnasium protocol on top of ClothSimulation.

The same seed and actions give the same bits in every fresh process. In a process that simulates a further episode the
start and the flight are still the same bits, but once cloth touches cloth the nodes may differ by millimetres, because
Bullet shuffles self-collision impulses with a seed that it never resets.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from layflat.data.format import schema
from layflat.data.types import ACTION_LIMIT_M, GroundTruth
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import disturbance_spec
from layflat.sim.errors import SimError, look_up
from layflat.sim.reward import DEFAULT_REWARD, REWARDS, Situation, potential
from layflat.sim.robots.registry import DEFAULT_ROBOT
from layflat.sim.simulation import ClothSimulation
from layflat.sim.tasks import DEFAULT_TASK, TASKS

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
    reward
        "contact", "shaped" or "sparse", see below.
    terminate_on_success
        Whether the episode ends where ``info["is_success"]`` becomes true, not before a disturbance has been.
    start
        Name of the start. None: ``hanging-quick`` where the program begins with ``hanging`` (the same place after a
        third of its simulation), else the task's. With "hanging" the start of a seed is the program's, to the bit.
    render_mode
        None or "rgb_array".
    **settings
        Further fields of `layflat.sim.config.SimConfig`, such as ``noise``, and every condition of `layflat config`.

    Notes
    -----
    Action: Box(-1, 1, (A,)), displacement of this step / ACTION_LIMIT_M in the order of the robot's axes; cut off at
    the limits. SimError for a wrong shape or a value that is not finite.

    Observation: what a policy may see, with the names, shapes and units of one row of ``obs`` in a session file
    (docs/reference/session-file.md): ``corner_positions`` (6,), ``depth`` (H, W, 1), numbers as (1,).

    All numbers are float32 (files keep float64).

    Reward: "contact" is the gain of the camera's contact portion in this step, which a real robot can measure too.
    "shaped" is the gain of `layflat.sim.reward.potential`, which knows the mesh; it moves from the first step on.
    "sparse" is 1 in each step that ends flat. The first two add up to the difference between an episode's ends.

    Terminated: the cloth has diverged; ``info["unstable"]`` says why, the observation is the last valid one, and the
    reward is 0 (for "shaped" the loss of the potential). With ``terminate_on_success`` also where the cloth is flat.

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
        reward: str = DEFAULT_REWARD,
        terminate_on_success: bool = False,
        start: str | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SimError(f"render_mode is {render_mode!r}; it must be None or 'rgb_array'")
        if disturbance is not None:
            disturbance_spec(disturbance)
        self.render_mode = render_mode
        self._reward = look_up("reward", reward, REWARDS)
        self._ends_flat = terminate_on_success
        start = start or look_up("task", task, TASKS).quick_start
        self.simulation = ClothSimulation(SimConfig.of(robot=robot, cloth=cloth, task=task, start=start, **settings))
        self._images = images
        self._disturbance, self._disturb_step = disturbance, disturb_step
        self._step_index = self._seed = 0
        self._truth: GroundTruth | None = None
        self._situation: Situation
        self._size = self.simulation.spec.robot.size
        self._spaces = self._make_spaces()
        self.action_space = spaces.Box(-1.0, 1.0, (self._size,), np.float32)
        self.observation_space = spaces.Dict({**self._spaces})  # type: ignore[assignment]  # gymnasium types it Dict[Any]

    def _make_spaces(self) -> dict[str, spaces.Box[Any]]:
        pinhole = self.simulation.pinhole
        sides = {"H": pinhole.height, "W": pinhole.width}
        sides |= {f"{side} of depth": length for side, length in sides.items()}
        boxes: dict[str, spaces.Box[Any]] = {}
        for field in schema.OBSERVATION_FIELDS:
            if self._images or not field.optional:
                shape = schema.row_shape(field, self.simulation.spec.robot, sides)
                low, high = schema.OBSERVATION_LIMITS[field.key]
                boxes[field.key] = spaces.Box(
                    low, high, shape, np.uint8 if np.dtype(field.dtype) == np.uint8 else np.float32
                )
        return boxes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsDict, dict[str, Any]]:
        """Start the episode of ``seed``; without one, of a random seed."""
        super().reset(seed=seed)
        self._seed = int(self.np_random.integers(2**31)) if seed is None else seed
        self.simulation.reset(self._seed)
        self._step_index = 0
        self._look()
        return self._as_dict(), self._info("")

    def step(self, action: NDArray[np.float32]) -> tuple[ObsDict, float, bool, bool, dict[str, Any]]:
        """Move the robot in one control step."""
        values = np.asarray(action, dtype=float)
        if values.shape != (self._size,) or not np.isfinite(values).all():
            raise SimError(f"the action is {values.tolist()}; it must be {self._size} finite numbers")
        if self._step_index == self._disturb_step and self._disturbance is not None:
            self.simulation.disturb(self._disturbance)
        self._step_index += 1
        self.simulation.step(np.clip(values, -1.0, 1.0) * ACTION_LIMIT_M)
        reason, before = self.simulation.divergence_reason(), self._situation
        if reason is None:
            self._look()
        else:  # The mesh of a diverged cloth means nothing.
            self._truth = None
            self._situation = replace(before, potential=0.0, is_success=False)
        reward = self._reward(before, self._situation)
        ended = reason is not None or (self._ends_flat and self._situation.is_success and not self._awaits_disturbance)
        return self._as_dict(), reward, ended, False, self._info(reason or "")

    @property
    def _awaits_disturbance(self) -> bool:
        return self._disturbance is not None and (self._step_index <= self._disturb_step or self.simulation.disturbed)

    def _look(self) -> None:
        """Observe, and note what the reward needs."""
        simulation = self.simulation
        self._observation = simulation.observe(images=self._images)
        self._truth = truth = simulation.ground_truth()
        self._situation = Situation(
            contact_portion=self._observation.contact_portion,
            potential=potential(truth, simulation.config.cloth_spec),
            is_success=simulation.config.task_spec.is_success(truth),
        )

    def _as_dict(self) -> ObsDict:
        values = {
            name: np.asarray(getattr(self._observation, name)).reshape(b.shape) for name, b in self._spaces.items()
        }
        return {name: np.clip(values[name].astype(b.dtype), b.low, b.high) for name, b in self._spaces.items()}

    def _info(self, unstable: str) -> dict[str, Any]:
        truth = self._truth
        return {
            "contact_portion_true": 0.0 if truth is None else truth.contact_portion_true,
            "flat_area": 0.0 if truth is None else truth.flat_area,
            "is_success": self._situation.is_success,
            "unstable": unstable,
            "seed": self._seed,
        }

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
