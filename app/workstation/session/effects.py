"""Effect of each command, and the sentence for a person, by the state of a session."""

from __future__ import annotations

from layflat.app.workstation.session.status import YOU, Message, SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.data.types import Outcome

NOTE_S = 3.0
"""Time for which it is said what has just happened, unless that stays true."""
ACTIVE = ("still", "running", "paused", "stopped", "finished", "asking")
STARTED = ("countdown", *ACTIVE)
OUTCOMES: dict[Command, Outcome] = {Command.KEEP_SUCCESS: "success", Command.KEEP_FAILURE: "failure"}


def effects(at: SessionStatus) -> dict[str, str]:
    """Return what each command would do now, by its name."""
    found = {command.name: _effect(command, at) for command in Command}
    return {name: text for name, text in found.items() if text is not None}


def _effect(command: Command, at: SessionStatus) -> str | None:
    state = at.state
    if state == "over":
        return None
    if command is Command.QUIT:
        return "end, keep this one as partial" if at.steps and at.recording else "end"
    if command is Command.START:
        if state == "running":
            return f"return control to {at.policy}" if at.controller == YOU and at.policy else None
        return {"waiting": f"start seed {at.seed}", "paused": "continue", "asking": "do not keep it yet"}.get(state)
    if command is Command.PAUSE:
        pauses = dict.fromkeys(("still", "running"), "pause")
        others = {"paused": "continue", "countdown": "stop the countdown", "asking": "do not keep it yet"}
        return (pauses | others).get(state)
    if command is Command.DISCARD and state in STARTED:
        return "discard this one" if at.recording and at.steps else "next seed"
    if command is Command.REDO and state in STARTED:
        return ("discard this one, " if at.recording and at.steps else "") + f"restart seed {at.seed}"
    if command is Command.UNDO and at.discarded is not None:
        return f"bring back seed {at.discarded[0]} with its {at.discarded[1]} steps"
    if command is Command.DISTURB and at.can_disturb and at.disturbance != "none":
        return f"disturb the cloth ({at.disturbance})"
    if command in OUTCOMES and at.recording and at.steps and state in ACTIVE:
        if at.stopped_by == "unstable" and command is Command.KEEP_SUCCESS:
            return None
        yes = "yes, " if at.asked == OUTCOMES[command] else ""
        return f"{yes}keep as {OUTCOMES[command]}"
    return None


def nothing_to(command: Command, at: SessionStatus) -> str:
    """Return what to say of a command that has no effect."""
    if not at.recording and command in OUTCOMES:
        return "nothing is recorded: choose a session file first"
    return f"nothing to {command.value} now"


def summary(n_episodes: int, file: str) -> str:
    """Return how many episodes a file has, as the end of a sentence; empty where nothing is recorded."""
    return f"; {n_episodes} {'demonstration' if n_episodes == 1 else 'demonstrations'} in {file}" if file else ""


def describe(at: SessionStatus) -> Message:
    """Return the sentence of the present state."""
    words = "" if at.verdict is None else at.verdict.words
    person = at.mode != "place"
    match at.state:
        case "waiting":
            return Message(text=f"seed {at.seed} hangs" if at.ready else f"hanging the cloth of seed {at.seed}")
        case "countdown":
            return Message(text=f"seed {at.seed}: " + ("get ready" if at.ready else "hanging the cloth"))
        case "still":
            return Message(text="time stands until you move")
        case "running":
            return Message(text=_running(at))
        case "paused":
            return Message(text=at.problem or "time stands until you continue", level="warning")
        case "stopped" if at.verdict is not None:
            flat = at.verdict.success
            text = f"{'Placed' if flat else 'Stopped'}: {words}" + ("; move to continue yourself" if person else "")
            return Message(text=text, level="success" if flat else "warning")
        case "finished" if at.stopped_by == "unstable":
            return Message(text="the simulation diverged" + _choices(at, "keep it as failure"), level="warning")
        case "finished":
            return Message(text=f"{words}; {at.steps} steps are the most{_choices(at, 'keep it')}", level="warning")
        case "asking":
            return Message(text=at.question, level="warning")
    return Message(text=f"the session has ended{summary(at.n_episodes, at.file)}")


def _choices(at: SessionStatus, keep: str) -> str:
    return f"; {keep}, discard it or redo it" if at.recording else "; take the next seed or this one again"


def _running(at: SessionStatus) -> str:
    if at.mode == "record":
        return "recording"
    if at.phase == "disturb":
        return "you pull at the cloth" if at.dragging else f"{at.policy} waits until the cloth has settled"
    if at.controller == YOU:
        return f"you are in control; stop moving to return control to {at.policy}"
    doing = "repairs" if at.phase == "repair" else "places"
    return f"{at.policy} {doing}" + ("; move to take over" if at.mode == "correct" else "")
