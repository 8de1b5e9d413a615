"""Speed of the simulation and of the models; each function runs once in a fresh process, on one core.

Wall time is that of blocks of whole steps, of which the median counts: other work of the machine, now and then, does
not matter. Blocks that are compared with each other alternate.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import Episode
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.policy.base import Policy
from layflat.policy.features import input_set
from layflat.policy.gp.fit import import_gpy
from layflat.policy.gp.kernel import JITTER, Hyperparameters, covariance
from layflat.policy.gp.model import GpModel
from layflat.policy.rollout import run_until_stop
from layflat.policy.runner import EpisodeRunner
from layflat.policy.scripted.baselines import DragPolicy, ZeroPolicy
from layflat.policy.stopping import AnyOf
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import robot_spec
from layflat.sim.simulation import ClothSimulation

SEED = 0
BLOCK_STEPS = 5
SETTLE_STEPS = 1
"""Steps at the beginning of each block that are not measured."""
BLOCKS, DRAG_BLOCKS = 8, 4
DRAG_STEP_M = 0.003
LAY_STEP_M = (0.014, 0.010)
"""Displacement forward and down in a step while the cloth is laid down."""
SEEING_STEPS = 12
SEEING_BLOCKS = 3
FRAMES = 30
GP_POINTS = 400
"""About as many as five demonstrations leave."""
EPISODE_STEPS = 100
"""Steps of the episode whose saving is timed: about as many as a demonstration has."""


def physics(robot: str, cloth: str, blocks: int = BLOCKS, n_steps: int = BLOCK_STEPS) -> dict[str, FloatArray]:
    """Measure without a camera. Wall s per step: ``air``, ``air bare``, ``drag``, ``flat``, ``flat bare``."""
    env = ClothSimulation(SimConfig(robot=robot, cloth=cloth, camera=False))
    try:
        env.reset(SEED)
        samples = _side_by_side(env, "air", blocks, n_steps)
        lay_down(env)
        drag = _moves(robot, DRAG_STEP_M, 0.0)
        samples["drag"] = np.array([_ours(env, drag, n_steps) for _ in range(DRAG_BLOCKS)])
        samples |= _side_by_side(env, "flat", blocks, n_steps)
        return samples
    finally:
        env.close()


def seeing(robot: str, cloth: str, folder: Path | None = None, n_steps: int = SEEING_STEPS) -> dict[str, FloatArray]:
    """Measure with camera, perception and recording, on the table.

    Wall s per step of a runner, with the share of a step in saving the episode: ``flat``, ``drag``. Wall s each
    of ``capture``, ``perceive`` (one frame) and ``keep`` (one episode of EPISODE_STEPS, durable in ``folder``).
    """
    env = ClothSimulation(SimConfig(robot=robot, cloth=cloth))
    try:
        env.reset(SEED)
        lay_down(env)
        with tempfile.TemporaryDirectory(prefix=".layflat-bench-", dir=folder) as place:
            path = Path(place) / "session.h5"
            with SessionRecorder(path, robot=robot_spec(robot), cloth=cloth) as recorder:
                return _seeing(env, recorder, n_steps)
    finally:
        env.close()


def _run(env: ClothSimulation, policy: Policy, n_steps: int) -> Episode:
    """Run a policy from where the simulation is now."""
    run = EpisodeRunner(env, policy, seed=SEED)
    return run.build_episode(run_until_stop(run, max_steps=n_steps))


def _seeing(env: ClothSimulation, recorder: SessionRecorder, n_steps: int) -> dict[str, FloatArray]:
    robot = env.config.robot
    policies: dict[str, Policy] = {
        "drag": DragPolicy(robot_spec(robot), name="drag", stop=AnyOf(), speed_m=DRAG_STEP_M),
        "flat": ZeroPolicy(robot_spec(robot)),
    }
    walls: dict[str, list[float]] = {}
    episode = _run(env, ZeroPolicy(robot_spec(robot)), 2)
    for name, policy in policies.items():
        for _ in range(SEEING_BLOCKS):
            began = time.perf_counter()
            episode = _run(env, policy, n_steps)
            walls.setdefault(name, []).append((time.perf_counter() - began) / n_steps)
    kept = lengthened(episode)
    keep = _repeat(lambda: recorder.save(kept), 5)
    frames = [env.camera.capture() for _ in range(3)]
    perceiver = PerceptionPipeline(env.camera.pinhole, flat_pixels=1000)
    return {name: np.array(wall) + np.median(keep) / len(kept.steps) for name, wall in walls.items()} | {
        "keep": keep,
        "capture": _repeat(env.camera.capture, FRAMES),
        "perceive": _repeat(lambda: perceiver.perceive(*frames[0]), FRAMES),
    }


def prediction(robot: str) -> dict[str, FloatArray]:
    """Measure one ``predict`` of mean and deviation, ours and GPy's, of GP_POINTS points and all inputs; wall s."""
    model = random_model(robot)
    here, there = np.zeros((1, model.layout.size)), np.zeros((1, model.layout.size))
    theirs = as_gpy(model)
    return alternating(
        {"predict": lambda: model.predict(here), "GPy": lambda: [process.predict(there) for process in theirs]}, 200
    )


def as_gpy(model: GpModel) -> list[Any]:
    """Return the same processes, one for each output, as GPy has them."""
    gpy, scaled = import_gpy(), model.inputs / model.input_scale
    processes = []
    for a, alpha in enumerate(model.alpha):
        noise = model.hyper.noise[a]
        target = covariance(scaled, scaled, model.hyper, a) @ alpha + (noise + JITTER) * alpha
        kernel = gpy.kern.RBF(
            scaled.shape[1], variance=model.hyper.variance[a], lengthscale=model.hyper.length_scales[a, 0]
        )
        processes.append(gpy.models.GPRegression(scaled, target[:, np.newaxis], kernel, noise_var=noise))
    return processes


def random_model(robot: str, points: int = GP_POINTS) -> GpModel:
    """Return a model as large as a trained one, and as good as chance."""
    layout, outputs = input_set(robot_spec(robot), "all"), robot_spec(robot).size
    rng = np.random.default_rng(SEED)
    return GpModel(
        policy="gp-word",
        layout=layout,
        cloth="towel",
        inputs=rng.uniform(-0.3, 0.5, (points, layout.size)),
        input_scale=layout.scales(),
        alpha=rng.normal(0.0, 1.0, (outputs, points)),
        output_scale_m=0.01,
        hyper=Hyperparameters(
            kernel="se",
            length_scales=np.ones((outputs, layout.size)),
            variance=np.ones(outputs),
            noise=np.full(outputs, 0.01),
        ),
    )


def lay_down(env: ClothSimulation, most_steps: int = 100) -> None:
    """Move down until the free edge touches, then forward and down until the held edge is at rest height."""
    robot, spec = env.config.robot, env.config.cloth_spec
    forward, down = LAY_STEP_M
    for _ in range(most_steps):
        height = float(env.robot.position()[2])
        if height < spec.margin_m + 0.002:
            break
        touches = bool(env.ground_truth().nodes[: spec.columns, 2].min() < 2 * spec.margin_m)
        # Where the arm yields, its hanger stays a little above its set point: steps of at least 0.5 mm bring it down.
        step = max(min(down, 0.3 * height), 0.0005)
        dx = forward * min(1.0, 0.3 + height / 0.05) if touches else 0.0
        env.step(_moves(robot, dx, -step if touches else -down))
    for _ in range(3):
        env.step(_moves(robot, 0.0, 0.0))


def _side_by_side(env: ClothSimulation, name: str, blocks: int, n_steps: int) -> dict[str, FloatArray]:
    """Measure steps without motion, and as many substeps of the same world by ``world.step`` alone, in turns."""
    zeros = _moves(env.config.robot, 0.0, 0.0)
    walls = [(_bare(env, n_steps), _ours(env, zeros, n_steps)) for _ in range(blocks)]
    bare, ours = np.array(walls).T
    return {name: ours, f"{name} bare": bare}


def _ours(env: ClothSimulation, action: FloatArray, n_steps: int) -> float:
    """Step and return wall s per step."""
    for _ in range(SETTLE_STEPS):
        env.step(action)
    began = time.perf_counter()
    for _ in range(n_steps):
        env.step(action)
    return (time.perf_counter() - began) / n_steps


def _bare(env: ClothSimulation, n_steps: int) -> float:
    """Step the world alone and return wall s per step."""
    world, substeps = env.cloth.world, round(env.config.step_s / env.cloth.world.coarse_substep_s)
    env.robot.hold()
    for _ in range(SETTLE_STEPS * substeps):
        world.step()
    began = time.perf_counter()
    for _ in range(n_steps * substeps):
        world.step()
    return (time.perf_counter() - began) / n_steps


def _repeat(work: Callable[[], object], times: int) -> FloatArray:
    """Return wall s of each call, (times,), after one call that is not counted."""
    return alternating({"work": work}, times)["work"]


def alternating(works: Mapping[str, Callable[[], object]], times: int) -> dict[str, FloatArray]:
    """Return wall s of each call, (times,), in turns, after one call each that is not counted."""
    walls: dict[str, list[float]] = {name: [] for name in works}
    for work in works.values():
        work()
    for _ in range(times):
        for name, work in works.items():
            began = time.perf_counter()
            work()
            walls[name].append(time.perf_counter() - began)
    return {name: np.array(wall) for name, wall in walls.items()}


def _moves(robot: str, dx: float, dz: float) -> FloatArray:
    """Return the action that moves the whole robot, (A,) m."""
    return robot_spec(robot).pack([dx, 0.0, dz])


def lengthened(episode: Episode) -> Episode:
    """Return the episode with its steps repeated up to EPISODE_STEPS."""
    times = -(-EPISODE_STEPS // len(episode.steps))
    return replace(episode, steps=(episode.steps * times)[:EPISODE_STEPS])
