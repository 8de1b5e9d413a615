"""`layflat record` when a person demonstrates: in the window where there is a display, else in the terminal."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from pathlib import Path

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workstation.session.episode_process import make_handle_factory
from layflat.app.workstation.session.recording_session import COUNTDOWN_S, RecordingSession
from layflat.app.workstation.session.session_queries import recorded_seeds
from layflat.app.workstation.teleop.registry import TELEOPERATORS, terminal_source
from layflat.app.workstation.terminal.display import (
    TerminalDisplay,
    introduce,
    run_recording,
    stops_on_signals,
    to_stdout,
)
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io as model_files
from layflat.policy.trained_model import TrainedModel
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import robot_spec


def record_teleoperated(wish: RecordConfig) -> None:
    """Record until ``wish.episodes`` are kept or the person quits; one line on stdout for each kept or discarded."""
    validators.one_of("disturbance", wish.disturb, DISTURBANCES)
    if wish.mapping is not None:
        validators.readable_file(wish.mapping, "a pad's mapping, by `layflat gamepad calibrate --file`")
    model = None if wish.correct is None else load_policy_to_correct(wish.correct, wish.robot, wish.descriptor)
    in_window = wish.window and has_display()
    if not in_window and not TELEOPERATORS[wish.source].terminal:
        missing = "there is no display" if not has_display() else "--no-window leaves none"
        raise LayflatError(
            f"--source {wish.source} needs the window, and {missing}; in a terminal --source keyboard and gamepad work,"
            " and scripted needs nobody"
        )
    if in_window:
        from layflat.app.workstation.window.launch import record_in_window

        record_in_window(wish)
    else:
        record_in_terminal(wish, model)


def record_in_terminal(wish: RecordConfig, model: TrainedModel | None) -> None:
    """Without a window. KeyboardInterrupt after Ctrl-C or SIGTERM, with everything kept by then."""
    settings = SimConfig(robot=wish.robot, cloth=wish.cloth, descriptor=wish.descriptor)
    screen = TerminalDisplay(sys.stderr)
    with ExitStack() as stack:
        stopped = stack.enter_context(stops_on_signals())
        hands = terminal_source(wish.source, robot_spec(wish.robot), mapping=wish.mapping)
        stack.callback(hands.close)
        recorder = stack.enter_context(
            SessionRecorder(
                wish.path,
                robot=robot_spec(wish.robot),
                cloth=wish.cloth,
                save_images=wish.images,
                descriptor=wish.descriptor,
            )
        )
        recording = RecordingSession(
            recorder,
            make_handle_factory(recorder, settings, wish.source, model=model),
            seed=wish.seed,
            skip=recorded_seeds(wish.path, wish.source if model is None else f"{model.policy}+{wish.source}"),
            led=model is not None,
            episodes=wish.episodes,
            disturbance=wish.disturb,
            countdown_s=COUNTDOWN_S,
            tell=to_stdout(screen),
        )
        stack.callback(recording.close)
        introduce(recording, hands, screen.say)
        cadence = run_recording(recording, hands, screen, step_s=settings.step_s, stopped=stopped)
        recording.close()
        screen.note(recording.message)
        screen.say(f"cadence: {cadence.rhythm().told()}")
        interrupted = stopped()
    if interrupted:
        raise KeyboardInterrupt


def load_policy_to_correct(path: Path, robot: str, descriptor: str) -> TrainedModel:
    """UsageError where the model was taught something else than what is to be recorded."""
    validators.readable_file(path, "a model that `layflat train` wrote")
    model = model_files.load(path)
    for name, taught, asked in (("robot", model.layout.robot, robot), ("descriptor", model.descriptor, descriptor)):
        if taught != asked:
            raise UsageError(f"{path} was taught with {name} {taught}, not {asked}; give --{name} {taught}")
    return model


def has_display() -> bool:
    """Whether a window could be seen."""
    if os.environ.get("SDL_VIDEODRIVER") in ("dummy", "offscreen"):
        return False
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
