"""`layflat record` when a person demonstrates: in the window where there is a display, else in the terminal."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from pathlib import Path

from app import checks
from app.errors import LayflatError, WrongCall
from app.wish import Wish
from app.workstation.inputs.registry import SOURCES, terminal_source
from app.workstation.recording import COUNTDOWN_S, Recording
from app.workstation.sofar import recorded_seeds
from app.workstation.take_process import begin_takes
from app.workstation.terminal import Screen, introduce, run_recording, stops_on_signals, to_stdout
from data.recorder import SessionRecorder
from data.types import Task
from policy import model as model_files
from policy.learned import Learned
from sim.disturbances import DISTURBANCES
from sim.settings import BenchSettings


def record_by_hand(wish: Wish) -> None:
    """Record until ``wish.episodes`` are kept or the person quits; one line on stdout for each kept or discarded."""
    checks.known_name("disturbance", wish.disturb, DISTURBANCES)
    if wish.mapping is not None:
        checks.readable_file(wish.mapping, "a pad's mapping, by `layflat gamepad calibrate --file`")
    model = None if wish.correct is None else model_to_correct(wish.correct, wish.task, wish.descriptor)
    in_window = wish.window and has_display()
    if not in_window and not SOURCES[wish.source].terminal:
        missing = "there is no display" if not has_display() else "--no-window leaves none"
        raise LayflatError(
            f"--source {wish.source} needs the window, and {missing}; in a terminal --source keyboard and gamepad work,"
            " and scripted needs nobody"
        )
    if in_window:
        from app.workstation.launch import record_in_window  # Here, since it loads all of the window.

        record_in_window(wish)
    else:
        record_in_terminal(wish, model)


def record_in_terminal(wish: Wish, model: Learned | None) -> None:
    """Without a window. KeyboardInterrupt after Ctrl-C or SIGTERM, with everything kept by then."""
    settings = BenchSettings(task=wish.task, cloth=wish.cloth, descriptor=wish.descriptor)
    screen = Screen(sys.stderr)
    with ExitStack() as stack:
        stopped = stack.enter_context(stops_on_signals())
        hands = terminal_source(wish.source, wish.task, mapping=wish.mapping)
        stack.callback(hands.close)
        recorder = stack.enter_context(
            SessionRecorder(
                wish.path, task=wish.task, cloth=wish.cloth, keep_images=wish.images, descriptor=wish.descriptor
            )
        )
        recording = Recording(
            recorder,
            begin_takes(recorder, settings, wish.source, model=model),
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
        cadence = run_recording(recording, hands, screen, tick_s=settings.tick_s, stopped=stopped)
        recording.close()
        screen.note(recording.message)
        screen.say(f"cadence: {cadence.rhythm().told()}")
        interrupted = stopped()
    if interrupted:
        raise KeyboardInterrupt


def model_to_correct(path: Path, task: Task, descriptor: str) -> Learned:
    """WrongCall where the model was taught something else than what is to be recorded."""
    checks.readable_file(path, "a model that `layflat train` wrote")
    model = model_files.load(path)
    for name, taught, asked in (("task", model.layout.task, task), ("descriptor", model.descriptor, descriptor)):
        if taught != asked:
            raise WrongCall(f"{path} was taught with {name} {taught}, not {asked}; give --{name} {taught}")
    return model


def has_display() -> bool:
    """Whether a window could be seen."""
    if os.environ.get("SDL_VIDEODRIVER") in ("dummy", "offscreen"):
        return False
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
