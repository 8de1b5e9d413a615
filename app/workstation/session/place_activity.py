"""PlaceActivity: a policy places the cloth, and the person may disturb it or take over at any time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Literal, TypeAlias

from layflat.app.support.session_lines import copy_note, kept_line
from layflat.app.workstation.session.activity_process import IDLE_S, Endpoint, Message
from layflat.app.workstation.session.command_effects import OUTCOMES
from layflat.app.workstation.session.input_channel import InputSample
from layflat.app.workstation.session.intervention import YOU, InterventionController
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.session.recording_session import ENDED_BY_PERSON
from layflat.app.workstation.session.requests import PlaceRequest
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data.session.recorder import EpisodeWriter
from layflat.data.types import DragTarget, Episode, Outcome, Phase, StoppedBy
from layflat.policy.base import continue_after_disturbance, max_extra_steps
from layflat.policy.runner import EpisodeRunner
from layflat.sim.config import SimConfig
from layflat.sim.simulation import ClothSimulation

State: TypeAlias = Literal["ready", "placing", "placed", "disturbing", "repairing", "over"]
PHASES: dict[State, Phase] = {"placing": "place", "disturbing": "disturb", "repairing": "repair"}
MAX_DISTURB_STEPS = 600
"""A person may drag the cloth for a minute."""
SETTLE_STEPS = 10
"""Steps for the cloth to settle after a drag, as after any disturbance."""
DISTURBANCE = "push"
"""Disturbance that a device's disturb button starts; the others have keys."""
NOT_RECORDED = "nothing is recorded: give a session file before placing"


class PlaceActivity:
    """One episode of a policy."""

    def __init__(
        self, request: PlaceRequest, endpoint: Endpoint, *, make_env: Callable[[SimConfig], Any] = ClothSimulation
    ) -> None:
        self._request = request
        self._endpoint = endpoint
        self._recorder = request.open_recorder()
        self.done = False
        self.state: State = "ready"
        self.paused = False
        self.message = ""
        self._stopped_by: StoppedBy = "interrupted"
        self._writer: EpisodeWriter | None = None
        self._settle_steps = 0
        self._phase_steps = 0
        self._n_disturbances = 0
        self._n_drag_steps = 0
        self._limiter = RateLimiter(request.sim_config.step_s, 0.0 if request.fast_forward else request.speed)
        self.env = make_env(request.sim_config)
        self.env.reset(request.seed)
        policy = request.policy.make(self.env)
        self._person = InterventionController(policy, request.source) if request.source else None
        self._policy_name = policy.name
        limits, extra = self.env.spec.limits, max_extra_steps(policy)
        self._max_steps: dict[State, int] = {
            "placing": limits.place + extra,
            "repairing": limits.repair + extra,
            "disturbing": MAX_DISTURB_STEPS,
        }
        self._policy_state: State = "placing"
        """State in which the policy decides: repairing, once the cloth was disturbed."""
        self._device_lost = False
        self.run = EpisodeRunner(
            self.env,
            policy if self._person is None else self._person.policy,
            seed=request.seed,
            keep_images=request.images,
            on_start=None if self._recorder is None else self._start_writer,
        )
        self._endpoint.channels.frames.publish(self.env, self.run)

    def _start_writer(self, beginning: Episode) -> EpisodeWriter:
        assert self._recorder is not None
        self._writer = self._recorder.start(beginning)
        return self._writer

    def handle_request(self, request: Message) -> None:
        """Handle ``start``, ``pause``, ``disturb`` and ``command`` (by ``name``), ``save`` and ``discard``."""
        name = request["request"]
        if name == "start" and self.state == "ready":
            self._enter("placing")
        elif name in ("pause", "start"):
            if self._device_lost:
                self.message = f"{self._policy_name} continues alone"
            self.paused, self._device_lost = name == "pause" and not self.paused, False
        elif name == "disturb" and self.state not in ("ready", "over"):
            self._disturb(str(request["name"]))
        elif name == "save":
            self._save()
        elif name == "discard":
            self._discard()
        elif name == "command":
            self._handle_command(Command[str(request["name"])])

    def _handle_command(self, command: Command) -> None:
        """Carry out a command of the person's device."""
        if self.effect(command) is None:
            unrecorded = self._recorder is None and command in (*OUTCOMES, Command.DISCARD)
            self.message = NOT_RECORDED if unrecorded else f"nothing to {command.value} now"
        elif command is Command.START and not self.paused and self._person is not None:
            self._person.release_control()
        elif command in (Command.START, Command.PAUSE):
            self.handle_request({"request": "pause"})
        elif command in OUTCOMES:
            self._save(OUTCOMES[command])
        elif command is Command.DISCARD:
            self._discard()
        elif command is Command.DISTURB:
            self._disturb(DISTURBANCE)
        else:
            self.done = True

    def effect(self, command: Command) -> str | None:
        """Return what a command of the person's device would do now, or None where it would do nothing."""
        if command is Command.QUIT:
            return "end, to the menu"
        if command is Command.START and not self.paused:
            return f"return control to {self._policy_name}" if self._controller() == YOU else None
        if command in (Command.START, Command.PAUSE):
            return "continue" if self.paused else "pause"
        if command is Command.DISTURB:
            return None if self.state in ("ready", "over") else f"disturb the cloth ({DISTURBANCE})"
        if command in (Command.REDO, Command.UNDO) or self._writer is None or not self.run.n_steps:
            return None
        if command is Command.DISCARD:
            return "discard this one"
        unstable = self._stopped_by == "unstable" and command is Command.KEEP_SUCCESS
        return None if unstable else f"keep as {OUTCOMES[command]}"

    def _controller(self) -> str:
        """Return who is in control, where a person may be."""
        if self._person is None or self.paused or self.state not in ("placing", "repairing"):
            return ""
        return YOU if self._person.human_in_control else self._policy_name

    def _read_input(self) -> InputSample | None:
        """Return the newest input of the window."""
        sample = self._endpoint.latest_input()
        if sample is not None and self._person is not None:
            self._handle_input(self._person, sample.teleop)
        return sample

    def _handle_input(self, person: InterventionController, teleop: TeleopInput) -> None:
        """Pause while the device is disconnected, as a recording does, unless the person continues without it."""
        change = person.handle_input(teleop)
        if change == "disconnected" and not self.paused:
            self.paused = self._device_lost = True
            self.message = f"paused: {teleop.problem}"
        elif change == "reconnected" and self._device_lost:
            self.paused = self._device_lost = False
            self.message = f"{teleop.device} is connected again; {self._policy_name} continues, move to take over"

    def _resume_for(self, drag: DragTarget | None) -> None:
        """Continue with a cloth that is placed when the person takes over, or drags it."""
        if self._person is not None and self._person.teleop.moving and self.state in ("placed", "disturbing"):
            self._stopped_by = "interrupted"
            self._enter(self._policy_state)
        elif self.state == "placed" and drag is not None:
            self._enter("disturbing")
            self.message = "you drag the cloth"

    def step(self) -> float:
        """Simulate a step when it is due."""
        sample = self._read_input()
        if not self.paused:
            self._resume_for(None if sample is None else sample.drag)
        if self.paused or self.state not in PHASES:
            self._limiter.pause()
            return IDLE_S
        remaining_s = self._limiter.remaining_s()
        if remaining_s > 0:
            return remaining_s
        self._limiter.start_step()
        started_s = time.monotonic()
        # Read again: an input that came while the step was waited for counts already.
        sample, before = self._read_input(), self._controller()
        drag = None if sample is None else sample.drag
        stop = self._run_step(drag)
        input_s, work_s = 0.0 if sample is None else sample.stamp_s, time.monotonic() - started_s
        self._limiter.end_step()
        self._endpoint.channels.frames.publish(self.env, self.run, input_s=input_s, work_s=work_s)
        if self._person is not None and self._controller() != before:
            self.message = self._person.describe()
        self._follow(stop, drag)
        return 0.0

    def _run_step(self, drag: DragTarget | None) -> StoppedBy | None:
        self._phase_steps += 1
        self._n_drag_steps += drag is not None
        if self._phase_steps > self._max_steps[self.state] and self._controller() != YOU:
            return "step_limit"
        return self.run.step(PHASES[self.state], drag)

    def _follow(self, stop: StoppedBy | None, drag: DragTarget | None) -> None:
        """Change the state after a step."""
        if stop == "unstable":
            self._stopped_by, self.message = stop, "the simulation diverged, which ends this episode"
            self._enter("over")
        elif self.state == "disturbing":
            self._settle_steps = SETTLE_STEPS if drag is not None else self._settle_steps - 1
            if stop is not None or (self._settle_steps <= 0 and not self.run.disturbed):
                continue_after_disturbance(self.run.policy)
                self._enter("repairing")
                self.message = f"{self._policy_name} continues"
        elif stop is not None and drag is None and not self.run.disturbed:
            self._stopped_by = stop
            contact = 100 * self.run.observation.contact_portion
            more = "" if self._person is None else "; move to continue yourself"
            self.message = f"stopped by {stop.replace('_', ' ')}, contact {contact:.0f} %{more}"
            self._enter("placed")
        elif stop is not None:
            # The policy has stopped while something still moves the cloth: wait for that, then continue.
            self._enter("disturbing")

    def _enter(self, state: State) -> None:
        self.state, self._phase_steps, self._settle_steps = state, 0, SETTLE_STEPS if state == "disturbing" else 0
        if state == "disturbing":
            self._policy_state = "repairing"
        if state == "placed" and self._request.fast_forward:
            self._limiter = RateLimiter(self._request.sim_config.step_s, self._request.speed)

    def _disturb(self, name: str) -> None:
        self.run.disturb(name, self._n_disturbances)
        self._n_disturbances += 1
        self.message = f"disturbance: {name}"
        if self.state in ("placed", "disturbing"):
            self._enter("disturbing")
            self._settle_steps = 0

    def _save(self, outcome: Outcome | None = None) -> None:
        """Save the episode with the person's verdict, which also ends it, or by how flat the cloth lies."""
        if self._writer is None:
            self.message = NOT_RECORDED
            return
        judged = outcome is not None and self._stopped_by == "interrupted"
        saved = self._writer.save(self.run.build_episode(ENDED_BY_PERSON if judged else self._stopped_by, outcome))
        self._writer, self.done = None, True
        self._enter("over")
        self._endpoint.send_event("saved", line=kept_line(saved), outcome=saved.outcome)
        if saved.copy_of is not None:
            self.message = copy_note(saved)

    def _discard(self) -> None:
        if self._writer is not None:
            self._writer.discard()
            self._writer = None
        self.done = True
        self._enter("over")
        self._endpoint.send_event("discarded", line=f"discarded seed {self.run.seed}")

    def status(self) -> dict[str, Any]:
        """Return the state, as JSON values."""
        timing, truth = self._limiter.timing(), self.run.ground_truth
        return {
            "state": self.state,
            "paused": self.paused,
            "policy": self.run.policy.name,
            "controller": self._controller(),
            "intervention_steps": sum(step.intervention for step in self.run.steps),
            "effects": {command.name: self.effect(command) for command in Command} if self._person else {},
            "contact": self.run.observation.contact_portion,
            "seed": self.run.seed,
            "steps": self.run.n_steps,
            "message": self.message,
            "recording": self._recorder is not None,
            "drag_steps": self._n_drag_steps,
            "disturbances": [record.name for record in self.run.disturbances],
            "timing": timing.describe(),
            "real_time_factor": timing.real_time_factor(self._request.sim_config.step_s),
            "flat_area": 0.0 if truth is None else truth.flat_area,
        }

    def close(self) -> None:
        """End the episode; without a verdict it is saved as partial, where it is recorded."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            if self._writer is not None and not self.run.n_steps:
                self._writer.discard()
            recorder.close()
        self.env.close()
