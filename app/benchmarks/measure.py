"""What `layflat bench` measures; each function once in a fresh process, on one core.

Wall time is that of blocks of whole steps; of several blocks the median counts, so that what else the machine does
now and then does not. Blocks that are compared with each other alternate.
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
"""At the beginning of each block, not measured."""
BLOCKS, FEWER_BLOCKS, DRAG_BLOCKS = 8, 4, 4
DRAG_STEP_M = 0.003
LAY_STEP_M = (0.014, 0.010)
"""Forward and down in a step while the cloth is laid down."""
SEEING_STEPS = 12
SEEING_BLOCKS = 3
FRAMES = 30
GP_POINTS = 400
"""About what five demonstrations leave."""
EPISODE_STEPS = 100
"""Of the episode whose keeping is timed: about what a demonstration has."""


def physics(robot: str, cloth: str, blocks: int = BLOCKS, n_steps: int = BLOCK_STEPS) -> dict[str, FloatArray]:
    """Without a camera. Wall s per step: ``air``, ``air bare``, ``drag``, ``flat``, ``flat bare``."""
    bench = ClothSimulation(SimConfig(robot=robot, cloth=cloth, camera=False))
    try:
        bench.reset(SEED)
        samples = _side_by_side(bench, "air", blocks, n_steps)
        lay_down(bench)
        drag = _moves(robot, DRAG_STEP_M, 0.0)
        samples["drag"] = np.array([_ours(bench, drag, n_steps) for _ in range(DRAG_BLOCKS)])
        samples |= _side_by_side(bench, "flat", blocks, n_steps)
        return samples
    finally:
        bench.close()


def seeing(robot: str, cloth: str, folder: Path | None = None, n_steps: int = SEEING_STEPS) -> dict[str, FloatArray]:
    """With camera, perception and recording, on the table.

    Wall s per step of a runner, with the share of a step in keeping the episode: ``flat``, ``drag``. Wall s each
    of ``capture``, ``perceive`` (one frame) and ``keep`` (one episode of EPISODE_STEPS, durable in ``folder``).
    """
    bench = ClothSimulation(SimConfig(robot=robot, cloth=cloth))
    try:
        bench.reset(SEED)
        lay_down(bench)
        with tempfile.TemporaryDirectory(prefix=".layflat-bench-", dir=folder) as place:
            path = Path(place) / "session.h5"
            with SessionRecorder(path, robot=robot_spec(robot), cloth=cloth) as recorder:
                return _seeing(bench, recorder, n_steps)
    finally:
        bench.close()


def _run(bench: ClothSimulation, policy: Policy, n_steps: int) -> Episode:
    """Run a policy from where the simulation is now."""
    run = EpisodeRunner(bench, policy, seed=SEED)
    return run.build_episode(run_until_stop(run, max_steps=n_steps))


def _seeing(bench: ClothSimulation, recorder: SessionRecorder, n_steps: int) -> dict[str, FloatArray]:
    robot = bench.config.robot
    policies: dict[str, Policy] = {
        "drag": DragPolicy(robot_spec(robot), name="drag", stop=AnyOf(), speed_m=DRAG_STEP_M),
        "flat": ZeroPolicy(robot_spec(robot)),
    }
    walls: dict[str, list[float]] = {}
    episode = _run(bench, ZeroPolicy(robot_spec(robot)), 2)
    for name, policy in policies.items():
        for _ in range(SEEING_BLOCKS):
            began = time.perf_counter()
            episode = _run(bench, policy, n_steps)
            walls.setdefault(name, []).append((time.perf_counter() - began) / n_steps)
    kept = lengthened(episode)
    keep = _repeat(lambda: recorder.save(kept), 5)
    frames = [bench.camera.capture() for _ in range(3)]
    perceiver = PerceptionPipeline(bench.camera.pinhole, flat_pixels=1000)
    return {name: np.array(wall) + np.median(keep) / len(kept.steps) for name, wall in walls.items()} | {
        "keep": keep,
        "capture": _repeat(bench.camera.capture, FRAMES),
        "perceive": _repeat(lambda: perceiver.perceive(*frames[0]), FRAMES),
    }


def predicting(robot: str) -> dict[str, FloatArray]:
    """Wall s of one ``predict`` of mean and deviation by a model of GP_POINTS points, all inputs: ours and GPy's."""
    model = random_model(robot)
    here, there = np.zeros((1, model.layout.size)), np.zeros((1, model.layout.size))
    theirs = as_gpy(model)
    return alternating(
        {"predict": lambda: model.predict(here), "GPy": lambda: [process.predict(there) for process in theirs]}, 200
    )


def as_gpy(model: GpModel) -> list[Any]:
    """The same processes, one for each output, as GPy has them."""
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
    """As large as a trained one, and as good as chance."""
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


def lay_down(bench: ClothSimulation, most_steps: int = 100) -> None:
    """Down until the free edge touches, then forward and down until the held edge is at rest height."""
    robot, spec = bench.config.robot, bench.config.cloth_spec
    forward, down = LAY_STEP_M
    for _ in range(most_steps):
        height = float(bench.robot.position()[2])
        if height < spec.margin_m + 0.002:
            break
        touches = bool(bench.ground_truth().nodes[: spec.columns, 2].min() < 2 * spec.margin_m)
        # Where the arm yields, its hanger stays a little above its set point: the steps never end before it is down.
        step = max(min(down, 0.3 * height), 0.0005)
        dx = forward * min(1.0, 0.3 + height / 0.05) if touches else 0.0
        bench.step(_moves(robot, dx, -step if touches else -down))
    for _ in range(3):
        bench.step(_moves(robot, 0.0, 0.0))


def _side_by_side(bench: ClothSimulation, name: str, blocks: int, n_steps: int) -> dict[str, FloatArray]:
    """Steps without motion by our loop, and as many substeps of the same world by ``world.step`` alone, in turns."""
    zeros = _moves(bench.config.robot, 0.0, 0.0)
    walls = [(_bare(bench, n_steps), _ours(bench, zeros, n_steps)) for _ in range(blocks)]
    bare, ours = np.array(walls).T
    return {name: ours, f"{name} bare": bare}


def _ours(bench: ClothSimulation, action: FloatArray, n_steps: int) -> float:
    """Wall s per step."""
    for _ in range(SETTLE_STEPS):
        bench.step(action)
    began = time.perf_counter()
    for _ in range(n_steps):
        bench.step(action)
    return (time.perf_counter() - began) / n_steps


def _bare(bench: ClothSimulation, n_steps: int) -> float:
    """Wall s per step of stepping alone."""
    world, substeps = bench.cloth.world, bench.config.substeps
    bench.robot.hold()
    for _ in range(SETTLE_STEPS * substeps):
        world.step()
    began = time.perf_counter()
    for _ in range(n_steps * substeps):
        world.step()
    return (time.perf_counter() - began) / n_steps


def _repeat(work: Callable[[], object], times: int) -> FloatArray:
    """(times,) s, after one call that is not counted."""
    work()
    walls = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        walls.append(time.perf_counter() - began)
    return np.array(walls)


def alternating(works: Mapping[str, Callable[[], object]], times: int) -> dict[str, FloatArray]:
    """(times,) s of each, in turns, after one call each that is not counted."""
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
    """(A,) m: the whole holder moves."""
    return robot_spec(robot).pack([dx, 0.0, dz])


def lengthened(episode: Episode) -> Episode:
    """With its steps repeated up to EPISODE_STEPS."""
    times = -(-EPISODE_STEPS // len(episode.steps))
    return replace(episode, steps=(episode.steps * times)[:EPISODE_STEPS])
