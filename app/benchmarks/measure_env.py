"""Speed of the Gymnasium environment: resets, steps with and without images, and two processes beside one."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial

import gymnasium
import numpy as np

from layflat.app.benchmarks.rows import PER_STEP, BenchmarkRow, Samples, comparison_row
from layflat.data.arrays import FloatArray
from layflat.sim.env import ClothPlaceEnv
from layflat.sim.robots.registry import DEFAULT_ROBOT
from layflat.sim.simulation import ClothSimulation

RESETS = 5
STEPS = 20
PROCESSES = (1, 2)
NAME = f"Gymnasium, {DEFAULT_ROBOT}"


def one(cloth: str, resets: int = RESETS, steps: int = STEPS) -> dict[str, FloatArray]:
    """Measure wall s: ``reset`` beside ``hanging`` (the program's start), ``step`` and ``image`` beside ``bare``."""
    make = partial(ClothPlaceEnv, DEFAULT_ROBOT, cloth=cloth)
    quick, whole, seeing = make(), make(start="hanging"), make(images=True)
    try:
        walls = [[_wall(partial(env.reset, seed=seed)) for env in (quick, whole)] for seed in range(resets)]
        seeing.reset(seed=0)
        still = np.zeros(quick.action_space.shape or (), np.float32)
        acts: tuple[Callable[[], object], ...] = (
            partial(quick.step, still),
            partial(seeing.step, still),
            partial(_bare_step, whole.simulation),
        )
        stepped = [[_wall(act) for act in acts] for _ in range(steps)]
    finally:
        for env in (quick, whole, seeing):
            env.close()
    columns = [*np.array(walls).T, *np.array(stepped).T]
    return dict(zip(("reset", "hanging", "step", "image", "bare"), columns, strict=True))


def processes(cloth: str, steps: int = STEPS) -> dict[str, FloatArray]:
    """Measure wall s of a step of each environment, by the number of processes."""
    walls = {}
    for number in PROCESSES:
        makers = [partial(ClothPlaceEnv, DEFAULT_ROBOT, cloth=cloth)] * number
        vector = gymnasium.vector.AsyncVectorEnv(makers)
        try:
            vector.reset(seed=0)
            still = np.zeros(vector.action_space.shape or (), np.float32)
            walls[str(number)] = np.array([_wall(partial(vector.step, still)) / number for _ in range(steps)])
        finally:
            vector.close()
    return walls


def _bare_step(simulation: ClothSimulation) -> None:
    simulation.step(simulation.spec.robot.zeros())
    simulation.observe(images=False)
    simulation.divergence_reason()


def _wall(act: Callable[[], object]) -> float:
    began = time.perf_counter()
    act()
    return time.perf_counter() - began


def one_rows(samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return a reset beside the program's start, and a step beside that of the simulation alone."""
    pairs = (("reset", "hanging", "ms"), ("step", "bare", PER_STEP), ("image", "bare", PER_STEP))
    names = {"reset": "reset / start of the program", "step": "step / simulation", "image": "step, images / simulation"}
    return [comparison_row(f"{NAME} {names[a]}", samples[a], samples[b], unit) for a, b, unit in pairs]


def process_rows(samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return the steps a second of two processes beside those of one."""
    one_s, many_s = (samples[str(number)] for number in PROCESSES)
    value, baseline = 1 / float(np.median(many_s)), 1 / float(np.median(one_s))
    name = f"{NAME} {PROCESSES[-1]} processes / 1"
    return [BenchmarkRow(name=name, value=value, unit="steps / s", baseline=baseline, samples=len(many_s))]
