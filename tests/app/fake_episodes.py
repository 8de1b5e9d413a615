"""Episodes without a simulator, made in an instant, and everything that can go wrong with them."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np

from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.run import run_evaluation
from layflat.app.support.errors import run_command
from layflat.app.support.progress import Progress
from layflat.app.workers.work_item import DisturbanceCase, WorkItem
from layflat.data.types import Episode, GroundTruth, Observation, Phase, Step
from layflat.policy.runner import StepCallback
from layflat.policy.schedule import ScheduledDisturbance, Trigger
from layflat.policy.spec import PolicySpec
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import robot_spec

Fault = Literal["kill", "segfault", "hang", "exception", "exit", "disk", "interrupt"]
FAULTS: tuple[Fault, ...] = tuple(fault for fault in get_args(Fault) if fault != "interrupt")
PLACING = "placing"
"""Place of a fault that is not in a case."""
OnStart = Callable[[Episode], StepCallback] | None


@dataclass(frozen=True)
class FakeEpisodes:
    """An episode factory with faults: by work item and place in it, one for each attempt; None for no fault."""

    faults: Mapping[tuple[str, str], tuple[Fault | None, ...]] = field(default_factory=dict)
    marks: Path = Path()
    """Folder that notes which disk has been full: it is full once."""
    step_s: float = 0.0
    """Wall time of a placement and of each case."""

    def __call__(self, item: WorkItem, on_start: OnStart) -> FakeEpisode:
        return FakeEpisode(self, item, on_start)

    def inject(self, item: WorkItem, where: str) -> None:
        planned = self.faults.get((key_of(item), where), ())
        fault = planned[item.attempt - 1] if len(planned) >= item.attempt else None
        if fault == "disk":
            mark = self.marks / f"full-{key_of(item)}-{where}".replace("/", ".")
            if not mark.exists():
                mark.touch()
                _raise_fault(fault)
        elif fault is not None:
            _raise_fault(fault)
        time.sleep(self.step_s)


class OpencvEpisodes(FakeEpisodes):
    """Episodes that use OpenCV, as every real one does."""

    def inject(self, item: WorkItem, where: str) -> None:
        cv2.setNumThreads(cv2.getNumThreads())
        cv2.resize(np.zeros((800, 800), np.float32), (2000, 2000))


class FakeEpisode:
    """An item's episode as numbers that follow from its name; a fault comes after three steps."""

    def __init__(self, factory: FakeEpisodes, item: WorkItem, on_start: OnStart) -> None:
        self._factory = factory
        self._item = item
        self._on_start = on_start
        self._placed = False

    def run_until_stop(self) -> None:
        self._factory.inject(self._item, PLACING)
        self._placed = True

    def run_case(self, case: DisturbanceCase) -> Episode:
        episode = fake_episode(self._item, case)
        if self._on_start is not None:
            first = episode.steps[0]
            beginning = replace(episode, steps=(), final_observation=first.observation, stopped_by="interrupted")
            callback = self._on_start(replace(beginning, final_ground_truth=first.ground_truth, outcome="partial"))
            for step_index, step in enumerate(episode.steps[:3]):
                callback.on_step(step, step_index + 1)
            time.sleep(0.1)  # The journal's thread writes them.
        if not self._placed:
            self.run_until_stop()
        self._factory.inject(self._item, case.name)
        return episode


def key_of(item: WorkItem) -> str:
    return f"{item.config.robot} {item.config.cloth} {item.policy.label} {item.seed}"


def _raise_fault(fault: Fault) -> None:
    if fault == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    elif fault == "segfault":
        faulthandler.disable()
        ctypes.string_at(0)
    elif fault == "hang":
        while True:
            ctypes.CDLL(None).sleep(1)
    elif fault == "exception":
        raise RuntimeError('the solver\nhas lost its way, and "says" so')
    elif fault == "exit":
        os._exit(7)
    elif fault == "interrupt":  # Ctrl-C reaches the program.
        os.kill(os.getppid(), signal.SIGINT)
        time.sleep(60)
    elif fault == "disk":
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))


def fake_episode(item: WorkItem, case: DisturbanceCase) -> Episode:
    """Return three steps of placing, and two for each disturbance; the numbers depend on the names alone."""
    rng = np.random.default_rng(list(f"{key_of(item)} {case.name}".encode()))
    phases: list[Phase] = ["place"] * 3
    for scheduled in case.schedule:
        phases += ["disturb", "repair"] * scheduled.repeats
    contact = [float(value) for value in rng.uniform(0, 1, len(phases) + 1)]
    observations = [
        Observation(
            time_s=0.1 * k,
            corner_positions=np.zeros((2, 3)),
            holder_position=np.zeros(3),
            word=np.zeros(2),
            word_strength=0.0,
            contact_portion=value,
        )
        for k, value in enumerate(contact)
    ]
    truths = [GroundTruth(nodes=np.zeros((4, 3)), contact_portion_true=c, flat_area=0.5 + c) for c in contact]
    robot = robot_spec(item.config.robot)
    steps = tuple(
        Step(observation=seen, ground_truth=truth, action=robot.zeros(), phase=phase)
        for seen, truth, phase in zip(observations, truths, phases, strict=False)
    )
    return Episode(
        robot=robot,
        cloth=item.config.cloth,
        task=item.config.task,
        seed=item.seed,
        source="fake",
        steps=steps,
        final_observation=observations[-1],
        final_ground_truth=truths[-1],
        stopped_by="converged",
        outcome="success",
        descriptor=item.config.descriptor,
        wall_s=0.5,
        decision_s=0.002,
        sim_config=item.config.environment_spec().config,
    )


def fake_plan(
    seeds: int = 4, *, policies: tuple[str, ...] = ("hold", "drag-rule"), limit_s: float = 60.0
) -> EvaluationPlan:
    """Return a plan with each start undisturbed, pushed after the stop, and blown at on the way."""
    push = ScheduledDisturbance(disturbance=DISTURBANCES["push"], repeats=2)
    early = ScheduledDisturbance(disturbance=DISTURBANCES["wind"], trigger=Trigger(kind="step", value=1))
    return EvaluationPlan(
        policies=tuple(PolicySpec(builtin=name) for name in policies),
        robots=("hanger",),
        cloths=("towel",),
        seeds=tuple(range(seeds)),
        cases=(DisturbanceCase(name="push", schedule=(push,)), DisturbanceCase(name="mix/early", schedule=(early,))),
        limit_s=limit_s,
    )


def main(out: str, seeds: str, workers: str, step_s: str) -> int:
    """Run an evaluation as a program of its own, which can be interrupted and killed."""
    plan = fake_plan(int(seeds))
    with Progress({"episodes": 1.0}) as progress:
        progress.phase("episodes", items=plan.n_episodes)
        episodes = FakeEpisodes(step_s=float(step_s))
        run_evaluation(plan, Path(out), workers=int(workers), make=episodes, progress=progress)
    return 0


if __name__ == "__main__":
    sys.exit(run_command(lambda: main(*sys.argv[1:])))
