"""`layflat record` by a person: in the window where there is a display, else in the terminal."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import Message, SessionEvent
from layflat.app.workstation.stop_signals import stop_on_signals
from layflat.app.workstation.teleop.registry import (
    IN_TERMINAL,
    TELEOPERATORS,
    make_terminal_teleoperator,
    usable_source,
)
from layflat.app.workstation.terminal.display import TerminalDisplay, print_instructions, run_recording
from layflat.app.workstation.window.launch import NoWindowError, has_display, run_window
from layflat.policy import model_io
from layflat.policy.spec import PolicySpec
from layflat.policy.trained_model import TrainedModel
from layflat.sim.disturbances.presets import DISTURBANCES


def record_teleoperated(config: RecordConfig) -> None:
    """Record until ``config.episodes`` are kept or the person quits; print a line for each kept or discarded one."""
    validators.one_of("source", config.source, TELEOPERATORS)
    validators.one_of("disturbance", config.disturb, DISTURBANCES)
    if config.mapping is not None:
        validators.readable_file(config.mapping, "a gamepad mapping, by `layflat gamepad calibrate --file`")
    model = None if config.correct is None else load_policy_to_correct(config.correct, config.robot, config.descriptor)
    in_terminal = config.source in IN_TERMINAL
    if config.window or (config.window is None and has_display()):
        try:
            run_window(session_request(config, model), print_event, config.mapping)
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


def session_request(config: RecordConfig, model: TrainedModel | None) -> SessionRequest:
    """Return the session of a recording by a person."""
    return SessionRequest(
        sim_config=config.sim_config(),
        variation=config.variation(),
        policy=None if model is None else PolicySpec(model=model),
        source=config.source,
        session=config.path,
        seed=config.seed,
        episodes=config.episodes,
        disturbance=config.disturb,
        images=config.images,
    )


def print_event(event: SessionEvent) -> None:
    """Print a line for scripts on stdout; a note for a person on stderr."""
    print(event.text, file=sys.stderr if event.kind == "note" else sys.stdout, flush=True)


def record_in_terminal(config: RecordConfig, model: TrainedModel | None) -> None:
    """Record without a window; KeyboardInterrupt after Ctrl-C or SIGTERM, with everything saved by then."""
    request, client = session_request(config, model), SessionClient()
    with ExitStack() as stack:
        stopped = stack.enter_context(stop_on_signals())
        robot = request.sim_config.robot_spec
        if sys.stdin and sys.stdin.isatty():  # Without a terminal there are no keys to fall back to.
            source, note = usable_source(config.source, robot, mapping=config.mapping)
            request = replace(request, source=source, note=Message(text=note, level="warning"))
        teleoperator = make_terminal_teleoperator(request.source, robot, mapping=config.mapping)
        stack.callback(teleoperator.close)
        display = TerminalDisplay(sys.stderr, teleoperator.help())
        stack.callback(client.end)
        client.start(request)
        if not display.live:
            print_instructions(teleoperator, display.print_line)
        run_recording(client, teleoperator, display, stopped=stopped)
        client.check()
        display.print_message(client.status.message)
        display.print_line(f"timing: {client.status.timing}")
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
