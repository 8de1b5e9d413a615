"""Episodes without a simulator, made in an instant, and everything that can go wrong with them."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import resource
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np

from layflat.app.evaluation.plan import DisturbanceCase, EvaluationPlan, PolicySpec, WorkItem
from layflat.app.evaluation.run import run_batch
from layflat.app.support.errors import run_command
from layflat.app.support.progress import Progress
from layflat.data.types import Episode, GroundTruth, Observation, Phase, Step
from layflat.policy.schedule import ScheduledDisturbance, Trigger
from layflat.sim.disturbances.presets import DISTURBANCES

Fault = Literal["kill", "segfault", "hang", "exception", "exit", "disk"]
FAULTS: tuple[Fault, ...] = get_args(Fault)
PLACING = "placing"
"""Where a fault may be instead of in a case."""


@dataclass(frozen=True)
class Scripted:
    """Which faults come: by group and where in it, one for each attempt; None or nothing: none."""

    faults: Mapping[tuple[str, str], tuple[Fault | None, ...]] = field(default_factory=dict)
    marks: Path = Path()
    """Where it is noted that a disk has been full: somebody makes room then."""
    step_s: float = 0.0
    """Wall time of a placing and of each case."""

    def __call__(self, group: WorkItem) -> FakePlaying:
        return FakePlaying(self, group)

    def suffer(self, group: WorkItem, where: str) -> None:
        planned = self.faults.get((key_of(group), where), ())
        fault = planned[group.attempt - 1] if len(planned) >= group.attempt else None
        if fault == "disk":
            mark = self.marks / f"full-{key_of(group)}-{where}".replace("/", ".")
            if not mark.exists():
                mark.touch()
                _suffer(fault)
        elif fault is not None:
            _suffer(fault)
        time.sleep(self.step_s)


class Looking(Scripted):
    """With a look at a picture, as every real episode has."""

    def suffer(self, group: WorkItem, where: str) -> None:
        cv2.setNumThreads(cv2.getNumThreads())
        cv2.resize(np.zeros((800, 800), np.float32), (2000, 2000))


class FakePlaying:
    """A group's episode as numbers that follow from its name."""

    def __init__(self, script: Scripted, group: WorkItem) -> None:
        self._script = script
        self._group = group
        self._placed = False

    def run_until_stop(self) -> None:
        self._script.suffer(self._group, PLACING)
        self._placed = True

    def finish(self, case: DisturbanceCase) -> Episode:
        if not self._placed:
            self.run_until_stop()
        self._script.suffer(self._group, case.name)
        return fake_episode(self._group, case)


def key_of(group: WorkItem) -> str:
    return f"{group.entrant.robot} {group.cloth} {group.entrant.name} {group.seed}"


def _suffer(fault: Fault) -> None:
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
    elif fault == "disk":
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))


def fake_episode(group: WorkItem, case: DisturbanceCase) -> Episode:
    """Three steps of placing, and two for each disturbance; the same numbers whoever makes them, and wherever."""
    words = f"{key_of(group)} {case.name}".encode()
    rng = np.random.default_rng(list(words))
    phases: list[Phase] = ["place"] * 3
    for item in case.schedule:
        phases += ["disturb", "repair"] * item.repeats
    contact = rng.uniform(0, 1, len(phases) + 1)
    observations = [_observation(0.1 * step_index, float(value)) for step_index, value in enumerate(contact)]
    ground_truths = [
        GroundTruth(nodes=np.zeros((4, 3)), contact_portion_true=float(c), flat_area=0.5 + float(c)) for c in contact
    ]
    size = 2 if group.entrant.robot == "hanger" else 6
    steps = tuple(
        Step(observation=seen, ground_truth=ground_truth, action=np.zeros(size), phase=phase)
        for seen, ground_truth, phase in zip(observations, ground_truths, phases, strict=False)
    )
    return Episode(
        robot=group.entrant.robot,
        cloth=group.cloth,
        seed=group.seed,
        source="fake",
        steps=steps,
        final_observation=observations[-1],
        final_ground_truth=ground_truths[-1],
        stopped_by="converged",
        outcome="success",
        descriptor=group.entrant.descriptor,
        wall_s=0.5,
    )


def _observation(time_s: float, contact: float) -> Observation:
    return Observation(
        time_s=time_s,
        corner_positions=np.zeros((2, 3)),
        holder_position=np.zeros(3),
        word=np.zeros(2),
        word_strength=0.0,
        contact_portion=contact,
    )


def fake_plan(
    seeds: int = 4, *, policies: tuple[str, ...] = ("hold", "drag-rule"), limit_s: float = 60.0
) -> EvaluationPlan:
    """Each start undisturbed, pushed after the stop, and pushed on the way."""
    push = ScheduledDisturbance(disturbance=DISTURBANCES["push"], repeats=2)
    early = ScheduledDisturbance(disturbance=DISTURBANCES["wind"], when=Trigger(kind="step", value=1))
    return EvaluationPlan(
        entrants=tuple(PolicySpec(name=name, robot="hanger", made=name) for name in policies),
        cloths=("towel",),
        seeds=tuple(range(seeds)),
        cases=(DisturbanceCase(name="push", schedule=(push,)), DisturbanceCase(name="mix/early", schedule=(early,))),
        limit_s=limit_s,
    )


def main(out: str, seeds: str, workers: str, step_s: str) -> int:
    """A batch as a program of its own, which can be interrupted and killed."""
    plan = fake_plan(int(seeds))
    with Progress({"episodes": 1.0}) as progress:
        progress.phase("episodes", items=plan.episodes)
        run_batch(plan, Path(out), workers=int(workers), play=Scripted(step_s=float(step_s)), progress=progress)
    return 0


if __name__ == "__main__":
    sys.exit(run_command(lambda: main(*sys.argv[1:])))
