"""EpisodeRunner: one episode, step by step: observe, decide, step, record."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.cloth_frame import recorded_settings
from layflat.data.provenance import capture_provenance
from layflat.data.types import DisturbanceRecord, DragTarget, Episode, Observation, Outcome, Phase, Step, StoppedBy
from layflat.policy.base import Decision, Policy
from layflat.policy.environment import Environment


class StepCallback(Protocol):
    """Callback called after every step: recorders, progress, windows, videos."""

    def on_step(self, step: Step, step_index: int) -> None:
        """Take note of a finished step."""


@runtime_checkable
class DisturbanceCallback(StepCallback, Protocol):
    """Callback that is also called when a disturbance starts or ends."""

    def on_disturbance(self, records: Sequence[DisturbanceRecord]) -> None:
        """Take note of all disturbances so far."""


class EpisodeRunner:
    """One episode of a policy in an environment that has been reset to ``seed``.

    The caller decides when it is paused, disturbed or over; `layflat.policy.rollout` has the usual order.
    """

    def __init__(
        self,
        env: Environment,
        policy: Policy,
        *,
        seed: int,
        disturbance: str = "none",
        keep_images: bool = False,
        callbacks: Sequence[StepCallback] = (),
        on_start: Callable[[Episode], StepCallback] | None = None,
    ) -> None:
        """Reset the policy and observe the start; the options are those of `layflat.policy.rollout.rollout`."""
        self.env, self.policy, self.seed = env, policy, seed
        self.disturbance = disturbance
        """Name of the disturbance, or of the suite of them, for the record."""
        self.steps: list[Step] = []
        self.disturbances: list[DisturbanceRecord] = []
        self.started_s = time.monotonic()
        """Clock of the machine when the episode started, for its wall time."""
        self._keep_images, self._callbacks, self._dragging = keep_images, tuple(callbacks), False
        self._decisions, self._decisions_s = 0, 0.0
        policy.reset(seed)
        self.observation = env.observe()
        """Observation at the start of the next step."""
        self.ground_truth = env.ground_truth()
        self._beginning = self._describe_beginning()
        if on_start is not None:
            self._callbacks = (*self._callbacks, on_start(self._beginning))

    @property
    def n_steps(self) -> int:
        """Number of finished steps."""
        return len(self.steps)

    @property
    def disturbed(self) -> bool:
        """Whether a disturbance still acts, or the cloth has not come to rest after it."""
        return self.env.disturbed

    def step(self, phase: Phase, drag: DragTarget | None = None, intervention: bool = False) -> StoppedBy | None:
        """Run one step; return why the phase is over, or None. In the phase ``disturb`` the robot rests.

        ``drag`` is where a person pulls the cloth; ``intervention`` marks that a person decided in place of the policy.
        """
        action, std, hand = self.env.spec.robot.zeros(), None, None
        if phase != "disturb":
            decision = self._decide()
            if decision.stop is not None:
                return decision.stop
            action, std, hand = decision.action, decision.std, decision.hand
            intervention = intervention or decision.intervention
        self._drag(drag)
        if hand is None:
            self.env.step(action)
        else:
            action = self.env.guide(hand)
        force = self.env.force_n()
        step = Step(
            observation=self._kept(self.observation),
            ground_truth=self.ground_truth,
            action=action,
            action_std=std,
            phase=phase,
            drag=drag,
            force_n=force if np.isfinite(force).all() else np.zeros(3),  # NaN where the simulation diverged
            intervention=intervention,
            hand_m=hand,
        )
        self.steps.append(step)
        if self.env.divergence_reason() is not None:
            # The nodes of a diverged cloth may not even be finite: the last sane ones stand for the end.
            return "unstable"
        if not self.env.disturbed:
            self._end_disturbance()
        self.observation, self.ground_truth = self.env.observe(), self.env.ground_truth()
        for callback in self._callbacks:
            callback.on_step(step, len(self.steps))
        return None

    def _decide(self) -> Decision:
        began_s = time.perf_counter()
        decision = as_decision(self.policy.act(self.observation))
        self._decisions, self._decisions_s = self._decisions + 1, self._decisions_s + time.perf_counter() - began_s
        return decision

    def run_phase(self, phase: Phase, max_steps: int) -> StoppedBy:
        """Run steps until the phase is over; return why."""
        for _ in range(max_steps):
            stop = self.step(phase)
            if stop is not None:
                return stop
            if phase == "disturb" and not self.disturbed:
                break
        return "step_limit"

    def disturb(self, disturbance: Any, repeat: int = 0) -> None:
        """Start a disturbance (see `Environment.disturb`) from the next step on; it replaces one that still acts."""
        record = self.env.disturb(disturbance, repeat)
        self._end_disturbance()
        if record is not None:
            self.disturbances.append(replace(record, first_step=len(self.steps), last_step=None))
            self._report_disturbances()

    def build_episode(self, stopped_by: StoppedBy, outcome: Outcome | None = None) -> Episode:
        """Return the episode so far; without an ``outcome`` the environment judges whether it is a success."""
        if outcome is None:
            outcome = "success" if stopped_by != "unstable" and self.env.success() else "failure"
        return replace(
            self._beginning,
            disturbance=self.disturbance,
            steps=tuple(self.steps),
            disturbances=tuple(record for record in self.disturbances if record.first_step < len(self.steps)),
            final_observation=self._kept(self.observation),
            final_ground_truth=self.ground_truth,
            stopped_by=stopped_by,
            outcome=outcome,
            wall_s=time.monotonic() - self.started_s,
            decision_s=self._decisions_s / self._decisions if self._decisions else None,
        )

    def _describe_beginning(self) -> Episode:
        """Return the episode as far as it is known before its first step."""
        spec, truth, shape = self.env.spec, self.ground_truth, self.env.spec.cloth_shape
        meshed = truth is not None and shape is not None and len(truth.nodes) == shape.rows * shape.columns
        return Episode(
            robot=spec.robot,
            task=spec.task,
            physics=spec.physics,
            cloth=spec.cloth,
            seed=self.seed,
            source=self.policy.name,
            steps=(),
            final_observation=self._kept(self.observation),
            final_ground_truth=self.ground_truth,
            stopped_by="interrupted",
            outcome="partial",
            step_s=spec.step_s,
            descriptor=spec.descriptor,
            disturbance=self.disturbance,
            start=self.env.start,
            sim_config=recorded_settings(spec.config, shape),
            initial_joints=self.env.joint_angles(),
            camera=spec.camera,
            mesh_shape=(shape.rows, shape.columns) if shape is not None and meshed else None,
            provenance=capture_provenance(),
        )

    def _kept(self, observation: Observation) -> Observation:
        kept = replace(observation, free_edge_m=None)
        return kept if self._keep_images else replace(kept, rgb=None, depth=None)

    def _drag(self, drag: DragTarget | None) -> None:
        if drag is not None:
            self.env.drag(drag.node, drag.target_m)
        elif self._dragging:
            self.env.release()
        self._dragging = drag is not None

    def _end_disturbance(self) -> None:
        """Note that the last disturbance ended with the last step; forget one that never acted."""
        last = self.disturbances[-1] if self.disturbances else None
        if last is None or last.last_step is not None:
            return
        self.disturbances.pop()
        if last.first_step < len(self.steps):
            self.disturbances.append(replace(last, last_step=len(self.steps) - 1))
        self._report_disturbances()

    def _report_disturbances(self) -> None:
        for callback in self._callbacks:
            if isinstance(callback, DisturbanceCallback):
                callback.on_disturbance(self.disturbances)


def as_decision(chosen: Decision | FloatArray) -> Decision:
    """Return what a policy chose as a Decision; a policy of one's own may return the action alone."""
    return chosen if isinstance(chosen, Decision) else Decision(action=chosen)
