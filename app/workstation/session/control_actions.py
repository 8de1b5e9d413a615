"""What each control does to a recording, by the state that it is in, as a person is told of it."""

from __future__ import annotations

from typing import Literal, TypeAlias

from layflat.app.workstation.session.episode_handle import EpisodeStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.data.types import Outcome

SessionState: TypeAlias = Literal["waiting", "countdown", "running", "paused", "finished", "over"]
"""waiting: for START, the next cloth hangs or is being hung. countdown: about to run. running: each ``step`` simulates
one; the first one waits for the first motion, so that no demonstration holds what nobody did. paused: by the person,
or because the device is gone. finished: the bench has stopped (step limit, unstable cloth) and only the verdict is
missing. over: nothing more is recorded."""

ACTIVE = ("running", "paused", "finished")
IN_HAND = ("countdown", *ACTIVE)
OUTCOMES: dict[Command, Outcome] = {Command.KEEP_SUCCESS: "success", Command.KEEP_FAILURE: "failure"}
VERBS = {
    Command.START: "begin",
    Command.PAUSE: "pause",
    Command.KEEP_SUCCESS: "keep as success",
    Command.KEEP_FAILURE: "keep as failure",
    Command.DISCARD: "discard",
    Command.REDO: "do again",
    Command.QUIT: "end",
    Command.DISTURB: "disturb",
}
"""What a control does, where it does anything."""


def control_action(
    control: Command, state: SessionState, glance: EpisodeStatus, *, seed: int, disturbance: str
) -> str | None:
    """What ``control`` would do now; None where it would do nothing.

    ``seed`` is that of the demonstration at hand, ``disturbance`` what DISTURB begins.
    """
    if state == "over":
        return None
    if control is Command.QUIT:
        return "end; what there is of this one is kept as partial" if glance.n_steps else "end the recording"
    if control is Command.START:
        begins = {"waiting": f"begin demonstration of seed {seed}", "paused": "go on"}
        return "hand back to the policy" if state == "running" and glance.led else begins.get(state)
    if control is Command.PAUSE:
        return {"running": "pause", "paused": "go on", "countdown": "not yet"}.get(state)
    if control is Command.DISCARD:
        return "forget this one" if state in IN_HAND else None
    if control is Command.REDO:
        return f"forget this one, the same start again (seed {seed})" if state in IN_HAND else None
    if control is Command.DISTURB:
        can = state in ("running", "paused") and disturbance != "none" and not glance.disturbed
        return f"disturb the cloth ({disturbance})" if can else None
    if state not in ACTIVE or not glance.n_steps:
        return None
    unstable = glance.stopped_by == "unstable"
    return None if unstable and control is Command.KEEP_SUCCESS else f"keep as {OUTCOMES[control]}"
