"""Take: one episode under way, its phases, and whether time stands."""

from __future__ import annotations

from dataclasses import dataclass, replace

from layflat.app.workstation.session.episode import EpisodeHandle
from layflat.app.workstation.session.status import YOU, EpisodeStatus, SessionStatus, State
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.types import DragTarget, Outcome, Phase, StoppedBy

MAX_STEPS = 600
"""A minute: several times what a demonstration takes, and enough to pull at the cloth."""
SETTLE_STEPS = 10
"""Steps for the cloth to settle after a drag, as after any disturbance."""


@dataclass
class Take:
    """One episode of a session. A policy places, waits while the cloth is disturbed, and repairs."""

    handle: EpisodeHandle
    has_policy: bool
    state: State = "waiting"
    phase: Phase = "place"
    stopped_by: StoppedBy | None = None
    """Why the policy or the simulation has stopped."""
    asked: Outcome | None = None
    """Label that a question is about."""
    drag_steps: int = 0
    n_disturbances: int = 0
    _before_asking: State = "paused"
    _policy_phase: Phase = "place"
    """Phase in which the policy decides: repair, once the cloth was disturbed."""
    _phase_steps: int = 0
    _settle_steps: int = 0
    _drag: DragTarget | None = None
    """Drag of the newest step."""

    @property
    def seed(self) -> int:
        """Seed of the episode."""
        return self.handle.seed

    @property
    def status(self) -> EpisodeStatus:
        """Newest state of the episode."""
        return self.handle.status or EpisodeStatus()

    @property
    def ready(self) -> bool:
        """Whether the cloth hangs."""
        return self.handle.status is not None

    @property
    def controller(self) -> str:
        """Controller of the next step; empty where neither person nor policy decides."""
        if self.state != "running" or self.phase == "disturb":
            return ""
        return YOU if not self.has_policy or self.status.human_in_control else self.status.policy

    @property
    def can_disturb(self) -> bool:
        """Whether a disturbance would act now."""
        active = self.state in ("still", "running", "paused", "stopped")
        return active and (self.has_policy or not self.status.disturbed)

    def moves(self, teleop: TeleopInput, drag: DragTarget | None) -> bool:
        """Return whether time runs, or begins to run with this input."""
        if self.state in ("still", "stopped"):
            return drag is not None or (teleop.moving and teleop.connected)
        return self.state == "running"

    def step(self, teleop: TeleopInput, drag: DragTarget | None) -> bool:
        """Begin a step; return False where it would be one too many, and time stands instead."""
        if self.has_policy and teleop.moving and (self.state == "stopped" or self.phase != self._policy_phase):
            self._enter(self._policy_phase)
        elif self.state == "stopped":
            self._enter("disturb")
        self.state = "running"
        if self._at_limit():
            self._stop("step_limit")
            return False
        self.stopped_by, self._drag = None, drag
        self._phase_steps += 1
        self.drag_steps += drag is not None
        self.handle.ask("step", self.phase, teleop, drag)
        return True

    def follow(self) -> None:
        """Change phase and state after a step."""
        stop = self.status.stopped_by
        if stop == "unstable":
            self.stopped_by, self.state = stop, "finished"
        elif self.phase == "disturb":
            self._settle_steps = SETTLE_STEPS if self._drag is not None else self._settle_steps - 1
            if self._settle_steps <= 0 and not self.status.disturbed:
                self._repair()
        elif stop is not None and (self._drag is not None or self.status.disturbed):
            self._enter("disturb")  # Something still moves the cloth: wait for that, then continue.
        elif stop is not None or (not self.has_policy and self._at_limit()):
            self._stop(stop or "step_limit")

    def pause(self) -> None:
        """Let time stand until the person continues, unless it stands anyway."""
        if self.state in ("running", "still"):
            self.state = "paused"
        elif self.state == "asking":
            self.state, self.asked = self._before_asking, None

    def proceed(self) -> None:
        """Let time run on, or stand until the person moves."""
        if self.stopped_by is not None:
            self.state = "stopped" if self.has_policy else "finished"
        else:
            self.state = "running" if self.has_policy else "still"

    def ask(self, outcome: Outcome) -> None:
        """Let time stand while a question is open."""
        self.pause()
        self._before_asking, self.asked, self.state = self.state, outcome, "asking"

    def disturb(self, name: str) -> None:
        """Start a named disturbance; a policy that has stopped waits for it and then repairs."""
        self.handle.ask("disturb", name, self.n_disturbances)
        self.n_disturbances += 1
        if self.has_policy and (self.state == "stopped" or self.phase == "disturb"):
            self._enter("disturb")
            self._settle_steps = 0
        if self.state == "stopped":
            self.stopped_by, self.state = None, "running"

    def show_in(self, shown: SessionStatus, *, dragging: bool) -> SessionStatus:
        """Return a session's status with that of this take."""
        at, judged = self.status, self.state in ("paused", "stopped", "finished", "asking")
        active = self.state in ("still", "running", "stopped")
        verdict = at.verdict if judged and at.steps else shown.verdict
        return replace(
            shown,
            **vars(at) | {"policy": at.policy or shown.policy, "verdict": verdict, "stopped_by": self.stopped_by},
            phase=self.phase,
            ready=self.ready,
            controller=self.controller,
            drag_steps=self.drag_steps,
            dragging=dragging and active,
            can_disturb=self.can_disturb,
            can_drag=active,
            asked=self.asked,
            question="" if self.asked is None or verdict is None else f"{verdict.words}: keep as {self.asked}?",
        )

    def _at_limit(self) -> bool:
        if not self.has_policy:
            return self.status.steps >= MAX_STEPS
        limits = self.status.limits
        most = {"place": limits.place, "repair": limits.repair, "disturb": MAX_STEPS}[self.phase]
        return self._phase_steps >= most and not self.status.human_in_control

    def _stop(self, stop: StoppedBy) -> None:
        if self.phase == "disturb":
            self._repair()
        else:
            self.stopped_by = stop
            if self.state == "running":
                self.proceed()

    def _repair(self) -> None:
        self.handle.ask("proceed")
        self._enter("repair")

    def _enter(self, phase: Phase) -> None:
        self.phase, self._phase_steps = phase, 0
        self._settle_steps = SETTLE_STEPS if phase == "disturb" else 0
        if phase == "disturb":
            self._policy_phase = "repair"
