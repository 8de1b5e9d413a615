"""RecordActivity: a person records demonstrations from the window, one after another, into one session."""

from __future__ import annotations

import multiprocessing
from dataclasses import replace
from typing import Any

from layflat.app.workstation.session.activity_process import IDLE_S, Endpoint, Message
from layflat.app.workstation.session.intervention import YOU
from layflat.app.workstation.session.old_episode import FramePublisher, make_handle_factory
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.session.recording_session import RecordingSession
from layflat.app.workstation.session.requests import RecordRequest
from layflat.app.workstation.session.session_queries import recorded_seeds
from layflat.app.workstation.teleop.teleop_input import Command


class RecordActivity:
    """A RecordingSession that takes its inputs from the window and publishes frames."""

    def __init__(self, request: RecordRequest, endpoint: Endpoint) -> None:
        recorder = request.open_recorder()
        if recorder is None or request.session is None:
            raise ValueError("a recording needs a session file")
        self._endpoint = endpoint
        self._step_s = request.sim_config.step_s
        self._recorder = recorder
        self._limiter = RateLimiter(self._step_s, request.speed)
        self._commands: list[Command] = []
        self._assisted_policy = "" if request.model is None else request.model.policy
        policies = [*filter(None, [self._assisted_policy]), request.source]
        make_episode = make_handle_factory(
            recorder,
            request.sim_config,
            request.source,
            on_step=FramePublisher(endpoint.channels.frames),
            # This process never steps a simulation and has no threads, so its episodes may be forked.
            context=multiprocessing.get_context("fork"),
            model=request.model,
        )
        self._recording = RecordingSession(
            recorder,
            make_episode,
            seed=request.seed,
            used_seeds=recorded_seeds(request.session, "+".join(policies)),
            policy_in_control=request.model is not None,
            episodes=request.episodes,
            disturbance=request.disturbance,
            countdown_s=request.countdown_s,
            print_line=lambda line: endpoint.send_event("line", line=line),
        )

    @property
    def done(self) -> bool:
        """Whether the recording is over."""
        return self._recording.state == "over"

    def handle_request(self, request: Message) -> None:
        """Handle ``command``, by its ``name``."""
        if request["request"] == "command":
            self._commands.append(Command[str(request["name"])])

    def step(self) -> float:
        """Simulate a step when it is due."""
        sample = self._endpoint.latest_input()
        if sample is None:
            return IDLE_S
        commands, self._commands = tuple(self._commands), []
        self._recording.handle_input(replace(sample.teleop, commands=commands))
        dragged = self._recording.waiting_for_motion and sample.drag is not None
        if not (self._recording.is_stepping or dragged):
            self._limiter.pause()
            self._recording.step()
            return IDLE_S
        remaining_s = self._limiter.remaining_s()
        if remaining_s > 0:
            return remaining_s
        self._limiter.start_step()
        self._recording.step(sample.drag)
        self._limiter.end_step()
        return 0.0

    def _controller(self) -> str:
        """Return who is in control, where a policy may be."""
        if not self._assisted_policy or self._recording.state != "running" or self._recording.waiting_for_motion:
            return ""
        return YOU if self._recording.status.human_in_control else self._assisted_policy

    def status(self) -> dict[str, Any]:
        """Return the state, as JSON values."""
        recording, timing = self._recording, self._limiter.timing()
        return {
            "state": recording.state,
            "ready": recording.state != "over" and recording.ready,
            "waiting_for_motion": recording.waiting_for_motion,
            "assisted_policy": self._assisted_policy,
            "controller": self._controller(),
            "countdown": recording.countdown_left_s(),
            "seed": recording.seed,
            "steps": recording.status.n_steps,
            "time_s": recording.status.time_s,
            "contact": recording.status.contact_portion,
            "flat_area": recording.status.flat_area,
            "counts": recording.counts,
            "n_episodes": recording.n_episodes,
            "message": recording.message,
            "effects": {command.name: recording.effect(command) for command in Command},
            "timing": timing.describe(),
            "real_time_factor": timing.real_time_factor(self._step_s),
        }

    def close(self) -> None:
        """End the recording; a running demonstration is kept as partial."""
        self._recording.close()
        self._recorder.close()
