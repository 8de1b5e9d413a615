"""Recording as the bench process does it: a person demonstrates, one take after another, into one session."""

from __future__ import annotations

import multiprocessing
from dataclasses import replace
from pathlib import Path
from typing import Any

from layflat.app.workstation.session.bench_process import IDLE_S, Endpoint, Request
from layflat.app.workstation.session.episode_process import make_handle_factory
from layflat.app.workstation.session.frame_publisher import FramePublisher
from layflat.app.workstation.session.intervention import YOU
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.session.recording_session import RecordingSession
from layflat.app.workstation.session.requests import recorder_of, settings_of
from layflat.app.workstation.session.session_queries import recorded_seeds
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.policy import model_io as model_files


class RecordTask:
    """The order: ``robot, cloth, descriptor, noise, step_s, speed, images, source, record, seed, countdown_s``,
    ``episodes`` (None: until told to end), ``disturbance`` and ``correct`` (the path of a model that places, and that
    the person takes over from; or empty)."""

    def __init__(self, order: Request, desk: Endpoint) -> None:
        self._desk = desk
        self._step_s = float(order["step_s"])
        settings, source = settings_of(order, descriptor=None), str(order["source"])
        correct = str(order.get("correct", ""))
        model = model_files.load(Path(correct)) if correct else None
        self._helped = "" if model is None else model.policy
        recorder = recorder_of(order, settings)
        if recorder is None:
            raise ValueError("a recording needs a session file")
        self._recorder = recorder
        self._cadence = RateLimiter(self._step_s, float(order["speed"]))
        self._controls: list[Command] = []
        self._path = Path(str(order["record"]))
        # This process never steps a simulation, and has no threads: its takes are forked.
        takes = make_handle_factory(
            recorder,
            settings,
            source,
            attend=FramePublisher(desk.channels.moments),
            context=multiprocessing.get_context("fork"),
            model=model,
        )
        self._recording = RecordingSession(
            recorder,
            takes,
            seed=int(order["seed"]),
            skip=recorded_seeds(self._path, f"{self._helped}+{source}" if self._helped else source),
            led=model is not None,
            episodes=order.get("episodes"),
            disturbance=str(order.get("disturbance", "none")),
            countdown_s=float(order["countdown_s"]),
            tell=lambda line: desk.tell("said", line=line),
        )

    @property
    def over(self) -> bool:
        return self._recording.state == "over"

    def obey(self, order: Request) -> None:
        """``control``: its ``name``."""
        if order["do"] == "control":
            self._controls.append(Command[str(order["name"])])

    def advance(self) -> float:
        letter = self._desk.letter()
        if letter is None:
            return IDLE_S
        controls, self._controls = tuple(self._controls), []
        self._recording.hear(replace(letter.reading, controls=controls))
        pull = letter.pull
        if not (self._recording.simulates or (self._recording.awaits_motion and pull is not None)):
            self._cadence.pause()
            self._recording.step()
            return IDLE_S
        left_s = self._cadence.left_s()
        if left_s > 0:
            return left_s
        self._cadence.begin()
        self._recording.step(pull)
        self._cadence.end()
        return 0.0

    def _leads(self) -> str:
        """Who decides, where a policy may; empty where nobody does."""
        if not self._helped or self._recording.state != "running" or self._recording.awaits_motion:
            return ""
        return YOU if self._recording.glance.led else self._helped

    def status(self) -> dict[str, Any]:
        recording, rhythm = self._recording, self._cadence.rhythm()
        return {
            "state": recording.state,
            "ready": recording.state != "over" and recording.ready,
            "awaits_motion": recording.awaits_motion,
            "helped": self._helped,
            "leads": self._leads(),
            "countdown": recording.countdown_left_s(),
            "seed": recording.seed,
            "steps": recording.glance.n_steps,
            "time_s": recording.glance.time_s,
            "contact": recording.glance.contact_portion,
            "flat_area": recording.glance.flat_area,
            "counts": recording.counts,
            "stored": recording.stored,
            "message": recording.message,
            "does": {control.name: recording.does(control) for control in Command},
            "rhythm": rhythm.told(),
            "factor": rhythm.factor(self._step_s),
        }

    def close(self) -> None:
        """A demonstration that runs is kept as partial."""
        self._recording.close()
        self._recorder.close()
