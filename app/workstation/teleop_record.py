"""`layflat record` by a person: in the window where there is a display, else in the terminal."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workstation.session.episode_process import make_handle_factory
from layflat.app.workstation.session.recording_session import RecordingSession
from layflat.app.workstation.session.session_queries import next_seeds, recorded_seeds, skipped_text
from layflat.app.workstation.teleop.registry import TELEOPERATORS, make_terminal_teleoperator
from layflat.app.workstation.terminal.display import TerminalDisplay, print_instructions, run_recording, stop_on_signals
from layflat.app.workstation.window.launch import NoWindowError, has_display, record_in_window
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io
from layflat.policy.trained_model import TrainedModel
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES


def record_teleoperated(config: RecordConfig) -> None:
    """Record until ``config.episodes`` are kept or the person quits; print a line for each kept or discarded one."""
    validators.one_of("source", config.source, TELEOPERATORS)
    validators.one_of("disturbance", config.disturb, DISTURBANCES)
    if config.mapping is not None:
        validators.readable_file(config.mapping, "a gamepad mapping, by `layflat gamepad calibrate --file`")
    model = None if config.correct is None else load_policy_to_correct(config.correct, config.robot, config.descriptor)
    in_terminal = TELEOPERATORS[config.source].terminal
    if config.window or (config.window is None and has_display()):
        try:
            record_in_window(config, model)
            return
        except NoWindowError as error:
            if config.window or not in_terminal:
                raise
            print(f"layflat: {str(error).partition(';')[0]}; recording in this terminal", file=sys.stderr)
    if not in_terminal:
        missing = "there is no display" if not has_display() else "--no-window leaves none"
        raise LayflatError(
            f"--source {config.source} needs the window, and {missing}; in a terminal use --source keyboard or"
            " gamepad, or scripted, which needs no person"
        )
    record_in_terminal(config, model)


def record_in_terminal(config: RecordConfig, model: TrainedModel | None) -> None:
    """Record without a window; KeyboardInterrupt after Ctrl-C or SIGTERM, with everything saved by then."""
    sim_config = SimConfig(robot=config.robot, cloth=config.cloth, descriptor=config.descriptor)
    display = TerminalDisplay(sys.stderr)
    with ExitStack() as stack:
        stopped = stack.enter_context(stop_on_signals())
        teleoperator = make_terminal_teleoperator(config.source, sim_config.robot_spec, mapping=config.mapping)
        stack.callback(teleoperator.close)
        recorder = stack.enter_context(
            SessionRecorder(
                config.path,
                robot=sim_config.robot_spec,
                cloth=config.cloth,
                save_images=config.images,
                descriptor=config.descriptor,
            )
        )
        source = config.source if model is None else f"{model.policy}+{config.source}"
        (seed,), skipped = next_seeds(config.path, source, 1, config.seed)
        if skipped:
            display.print_line(skipped_text(config.path, skipped, [seed]))
        recording = RecordingSession(
            recorder,
            make_handle_factory(recorder, sim_config, config.source, model=model),
            seed=seed,
            used_seeds=recorded_seeds(config.path, source),
            policy_in_control=model is not None,
            episodes=config.episodes,
            disturbance=config.disturb,
            print_line=display.print_result,
        )
        stack.callback(recording.close)
        print_instructions(recording, teleoperator, display.print_line)
        limiter = run_recording(recording, teleoperator, display, step_s=sim_config.step_s, stopped=stopped)
        recording.close()
        display.print_message(recording.message)
        display.print_line(f"timing: {limiter.timing().describe()}")
        interrupted = stopped()
    if interrupted:
        raise KeyboardInterrupt


def load_policy_to_correct(path: Path, robot: str, descriptor: str) -> TrainedModel:
    """Load a model; UsageError where it was trained for something else than what is recorded."""
    validators.readable_file(path, "a model that `layflat train` wrote")
    model = model_io.load(path)
    for name, trained, asked in (("robot", model.layout.robot, robot), ("descriptor", model.descriptor, descriptor)):
        if str(trained) != asked:
            raise UsageError(f"{path} was trained with {name} {trained}, not {asked}; give --{name} {trained}")
    return model
