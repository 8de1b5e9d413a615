"""Effect of each command on a recording, by its state, in words for a person."""

from __future__ import annotations

from typing import Literal, TypeAlias

from layflat.app.workstation.session.episode_handle import EpisodeStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.data.types import Outcome

SessionState: TypeAlias = Literal["waiting", "countdown", "running", "paused", "finished", "over"]
"""waiting: for START; the next cloth hangs, or is being hung. countdown: about to run. running: each ``step`` simulates
one; the first one waits for the first motion, so that a demonstration starts with it. paused: by the person, or because
the device is disconnected. finished: the simulation has stopped (step limit, divergence) and only the verdict is
missing. over: nothing more is recorded."""

ACTIVE = ("running", "paused", "finished")
STARTED = ("countdown", *ACTIVE)
OUTCOMES: dict[Command, Outcome] = {Command.KEEP_SUCCESS: "success", Command.KEEP_FAILURE: "failure"}


def command_effect(
    command: Command, state: SessionState, status: EpisodeStatus, *, seed: int, disturbance: str
) -> str | None:
    """Return what a command would do now, or None where it would do nothing.

    ``seed`` is that of the current demonstration, ``disturbance`` what DISTURB starts.
    """
    if state == "over" or command is Command.UNDO:
        return None
    if command is Command.QUIT:
        return "end, keep this one as partial" if status.n_steps else "end the recording"
    if command is Command.START:
        starts = {"waiting": f"start demonstration of seed {seed}", "paused": "continue"}
        return "return control to the policy" if state == "running" and status.human_in_control else starts.get(state)
    if command is Command.PAUSE:
        return {"running": "pause", "paused": "continue", "countdown": "stop the countdown"}.get(state)
    if command is Command.DISCARD:
        return "discard this one" if state in STARTED else None
    if command is Command.REDO:
        return f"discard this one, restart seed {seed}" if state in STARTED else None
    if command is Command.DISTURB:
        can = state in ("running", "paused") and disturbance != "none" and not status.disturbed
        return f"disturb the cloth ({disturbance})" if can else None
    if state not in ACTIVE or not status.n_steps:
        return None
    unstable = status.stopped_by == "unstable"
    return None if unstable and command is Command.KEEP_SUCCESS else f"keep as {OUTCOMES[command]}"
