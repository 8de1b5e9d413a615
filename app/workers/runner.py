"""Run: one episode in the making, step by step; whoever drives it decides when it is paused, disturbed or over."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from layflat.app.support.provenance import capture_provenance
from layflat.data.arrays import FloatArray
from layflat.data.types import DisturbanceRecord, DragTarget, Episode, Observation, Outcome, Phase, Step, StoppedBy
from layflat.policy.base import Policy
from layflat.sim.disturbances.presets import DisturbanceSpec
from layflat.sim.simulation import ClothSimulation


class StepCallback(Protocol):
    """Hears of each step: progress, windows, films."""

    def on_step(self, step: Step, step_index: int) -> None: ...


@runtime_checkable
class DisturbanceCallback(StepCallback, Protocol):
    """A hook that also hears of what befalls the cloth between two steps."""

    def on_disturbance(self, records: Sequence[DisturbanceRecord]) -> None: ...


class EpisodeRunner:
    """One episode in the making, on a bench that has been reset to ``seed``.

    With ``images`` each step keeps the camera's frame (about 0.5 MB). ``begin`` is told the episode before its first
    step, and makes a hook of it: a journal (``SessionRecorder.begin``). ``disturbance`` names what is to befall the
    cloth ("none", a disturbance, a suite), for the record.
    """

    def __init__(
        self,
        bench: ClothSimulation,
        policy: Policy,
        *,
        seed: int,
        disturbance: str = "none",
        images: bool = False,
        hooks: Sequence[StepCallback] = (),
        begin: Callable[[Episode], StepCallback] | None = None,
    ) -> None:
        self.bench = bench
        self.policy = policy
        self.seed = seed
        self.disturbance = disturbance
        """For the record: "none", or what befalls the cloth by its name, also that of a suite."""
        self.steps: list[Step] = []
        self.disturbances: list[DisturbanceRecord] = []
        self._images = images
        self._hooks = tuple(hooks)
        self._zeros = bench.spec.robot.zeros()
        self._pulling = False
        self.began_s = time.monotonic()
        """By the machine's clock, for the wall time of the whole."""
        policy.reset(seed)
        self.seen = bench.observe()
        """What the next step begins with."""
        self.ground_truth = bench.ground_truth()
        self._beginning = self._describe_beginning(disturbance)
        if begin is not None:
            self._hooks = (*self._hooks, begin(self._beginning))

    @property
    def n_steps(self) -> int:
        return len(self.steps)

    @property
    def disturbed(self) -> bool:
        """A disturbance still acts, or the cloth has not come to rest after it."""
        return self.bench.disturbed

    def step(self, phase: Phase, pull: DragTarget | None = None, intervention: bool = False) -> StoppedBy | None:
        """observe (done before) -> decide -> step -> record; says why the phase is over, or None.

        In the phase ``disturb`` nobody decides: the holder rests. ``pull`` is what a person draws the cloth by in this
        step; ``intervention`` marks that a person decided it although a policy has the lead.
        """
        action, std, hand = self._zeros, None, None
        if phase != "disturb":
            decision = self.policy.act(self.seen)
            if decision.stop is not None:
                return decision.stop
            action, std, hand = decision.action, decision.std, decision.hand
            intervention = intervention or decision.intervention
        self._pull(pull)
        if hand is None:
            self.bench.step(action)
        else:
            action = self.bench.guide(hand)
        step = Step(
            observation=self._kept(self.seen),
            ground_truth=self.ground_truth,
            action=action,
            action_std=std,
            phase=phase,
            pull=pull,
            force_n=self._force(),
            intervention=intervention,
            hand_m=hand,
        )
        self.steps.append(step)
        if self.bench.divergence_reason() is not None:
            # The nodes of a diverged cloth may not even be finite: the last sane ones stand for the end.
            return "unstable"
        if not self.bench.disturbed:
            self._note_end()
        self.seen, self.ground_truth = self.bench.observe(), self.bench.ground_truth()
        for hook in self._hooks:
            hook.on_step(step, len(self.steps))
        return None

    def disturb(self, what: str | DisturbanceSpec, repeat: int = 0) -> None:
        """Begin a disturbance; it acts from the next step on. Each ``repeat`` has a chance of its own."""
        self._note_beginning(self.bench.disturb(what, repeat))

    def disturb_as(self, record: DisturbanceRecord) -> None:
        """Begin a recorded disturbance again as it was, whatever its name stands for by now."""
        self._note_beginning(self.bench.disturb(record))

    def phase(self, phase: Phase, n_steps: int) -> StoppedBy:
        """Steps until the phase is over; says why."""
        for _ in range(n_steps):
            stop = self.step(phase)
            if stop is not None:
                return stop
            if phase == "disturb" and not self.disturbed:
                break
        return "step_limit"

    def episode(self, stopped_by: StoppedBy, outcome: Outcome | None = None) -> Episode:
        """What there is of it; the outcome is judged by how flat the cloth lies where nobody says otherwise."""
        if outcome is None:
            outcome = "success" if stopped_by != "unstable" and self.bench.success() else "failure"
        return replace(
            self._beginning,
            disturbance=self.disturbance,
            steps=tuple(self.steps),
            disturbances=tuple(record for record in self.disturbances if record.first_step < len(self.steps)),
            final_observation=self._kept(self.seen),
            final_ground_truth=self.ground_truth,
            stopped_by=stopped_by,
            outcome=outcome,
            wall_s=time.monotonic() - self.began_s,
        )

    def _describe_beginning(self, disturbance: str) -> Episode:
        """The episode as far as it is known before its first step."""
        bench, spec = self.bench, self.bench.spec
        return Episode(
            robot=spec.robot,
            cloth=spec.cloth,
            seed=self.seed,
            source=self.policy.name,
            steps=(),
            final_observation=self._kept(self.seen),
            final_ground_truth=self.ground_truth,
            stopped_by="interrupted",
            outcome="partial",
            step_s=spec.step_s,
            task=spec.task,
            physics=spec.physics,
            descriptor=spec.descriptor,
            disturbance=disturbance,
            start=bench.start,
            sim_config=spec.config,
            initial_joints=bench.joint_angles(),
            provenance=capture_provenance(),
        )

    def _kept(self, observation: Observation) -> Observation:
        if self._images:
            return replace(observation, free_edge_m=None)
        return replace(observation, free_edge_m=None, rgb=None, depth=None)

    def _pull(self, pull: DragTarget | None) -> None:
        if pull is not None:
            self.bench.drag(pull.node, pull.target_m)
        elif self._pulling:
            self.bench.release()
        self._pulling = pull is not None

    def _force(self) -> FloatArray:
        """Of a cloth that has diverged it may not be a number."""
        force = self.bench.force_n()
        return force if np.isfinite(force).all() else np.zeros(3)

    def _note_beginning(self, record: DisturbanceRecord | None) -> None:
        """One that still acts gives way to the new one."""
        self._note_end()
        if record is not None:
            self.disturbances.append(replace(record, first_step=len(self.steps)))
            self._tell()

    def _note_end(self) -> None:
        """The last disturbance was over with the last step; one that never acted has not been."""
        last = self.disturbances[-1] if self.disturbances else None
        if last is None or last.last_step is not None:
            return
        self.disturbances.pop()
        if last.first_step < len(self.steps):
            self.disturbances.append(replace(last, last_step=len(self.steps) - 1))
        self._tell()

    def _tell(self) -> None:
        for hook in self._hooks:
            if isinstance(hook, DisturbanceCallback):
                hook.on_disturbance(self.disturbances)
