"""LivePanel: the session that runs, with what each button does now."""

from __future__ import annotations

from functools import partial

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.web.viewer import Viewer
from layflat.app.workstation.web.widgets import facts, put, sentence
from layflat.data.format import schema
from layflat.data.session.reader import open_session
from layflat.sim.disturbances.presets import DISTURBANCES

COMMANDS = {
    Command.START: ("S", "teal"),
    Command.PAUSE: ("P", None),
    Command.KEEP_SUCCESS: ("Y", "green"),
    Command.KEEP_FAILURE: ("N", "yellow"),
    Command.DISCARD: ("X", "red"),
    Command.REDO: ("R", None),
    Command.UNDO: ("U", None),
    Command.DISTURB: ("B", "orange"),
}
"""Key and colour of each command, in the order of the buttons."""
HEADLINES = {
    "starting": "Starting the simulation",
    "waiting": "Ready",
    "countdown": "Get ready",
    "still": "Go",
    "running": "Running",
    "paused": "Paused",
    "stopped": "Stopped",
    "finished": "Keep it?",
    "asking": "A question",
    "over": "Ended",
}
PHASES = {"disturb": "Disturbed", "repair": "Repairing"}
LABELS = (Command.KEEP_SUCCESS, Command.KEEP_FAILURE, Command.DISCARD)
RARE = (Command.REDO, Command.UNDO, Command.DISTURB)
"""Commands whose buttons are below the others, and only there while they have an effect."""


class LivePanel:
    """Buttons and numbers of the running session, in a viewer's page."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer
        self._workstation = viewer.workstation
        gui = viewer.client.gui
        self._headline = gui.add_html("")
        self._verdict = gui.add_html("")
        self._question = gui.add_html("")
        self._answer = gui.add_button_group("Answer", ("Yes", "No"), visible=False)
        viewer.on_click(self._answer, self._send_answer, control=True)
        self._buttons = {}
        self._keys = []
        for command, (key, color) in COMMANDS.items():
            button = gui.add_button(command.value.capitalize(), color=color, disabled=True)  # type: ignore[arg-type]
            viewer.on_click(button, partial(self._send, command), control=True)
            self._buttons[command] = button
            hotkey = gui.add_command(command.value.capitalize(), hotkey=key)  # type: ignore[arg-type]
            hotkey.on_trigger(viewer.reaction(partial(self._send, command), control=True))
            self._keys.append(hotkey)
        named = tuple(name for name in DISTURBANCES if name != "none")
        self._disturb = gui.add_button_group("Disturb", named, visible=False)
        viewer.on_click(self._disturb, self._send_disturbance, control=True)
        self._ghost = gui.add_checkbox("Ghost of the best end", False, visible=False)
        viewer.on_change(self._ghost, self._show_ghost)
        self._facts = gui.add_html("")
        self.update()

    def close(self) -> None:
        """Take keys and ghost away."""
        self._viewer.scene.show_ghost(None)
        for hotkey in self._keys:
            hotkey.remove()

    def _send(self, command: Command) -> None:
        if self._workstation.session.status.effect(command) is not None:
            self._workstation.session.send_command(command, self._viewer.name)

    def _send_answer(self) -> None:
        self._workstation.session.answer(self._answer.value == "Yes", self._viewer.name)

    def _send_disturbance(self) -> None:
        if self._disturb.value in DISTURBANCES:
            self._workstation.session.disturb(str(self._disturb.value), self._viewer.name)

    def _show_ghost(self) -> None:
        """Show how the cloth lies at the end of the best success of the session."""
        request = self._workstation.session.request
        nodes = None
        if self._ghost.value and request is not None and request.session is not None:
            with open_session(request.session) as session:
                flat = {name: session.info(name).flat_area_final or 0.0 for name in session.select(outcome="success")}
                if not flat:
                    raise LayflatError(f"{request.session.name} has no success yet, whose end could be shown")
                nodes = session.array(max(flat, key=lambda name: flat[name]), schema.FINAL_STATE).reshape(-1, 3)
        self._viewer.scene.show_ghost(nodes)

    def update(self) -> None:
        """Show the newest status."""
        status, frame = self._workstation.session.status, self._workstation.session.frame
        level = "warning" if status.state in ("paused", "asking") else "info"
        put(self._headline, content=f"<b>{sentence(headline(status), level)}</b>{_message(status)}")  # type: ignore[arg-type]
        put(self._verdict, content=verdict(status))
        put(self._question, content=sentence(status.question, "warning"))
        put(self._answer, visible=bool(status.question))
        for command, button in self._buttons.items():
            effect = status.effect(command)
            label = (effect or command.value).capitalize()
            visible = status.recording if command in LABELS else effect is not None or command not in RARE
            put(button, label=f"{label} ({COMMANDS[command][0]})", disabled=effect is None, visible=visible)
        put(self._disturb, visible=status.can_disturb)
        put(self._ghost, visible=status.recording)
        put(self._facts, content=facts(numbers(status)))
        self._viewer.monitor.show(frame, self._workstation.series)


def headline(status: SessionStatus) -> str:
    """Return the state in a few words."""
    if status.state == "countdown":
        return f"Get ready: {status.countdown_s:.0f}"
    if status.state == "waiting" and not status.ready:
        return f"Hanging the cloth of seed {status.seed}"
    if status.state == "running":
        who = "You are in control" if status.controller == "you" and status.policy else ""
        return who or PHASES.get(status.phase, "Placing" if status.policy else "Recording")
    return HEADLINES[status.state]


def _message(status: SessionStatus) -> str:
    """Return the message, unless it stands beside the same words."""
    text = status.message.text
    return (
        ""
        if text.lower() in (headline(status).lower(), status.question.lower())
        else sentence(text, status.message.level)
    )


def verdict(status: SessionStatus) -> str:
    """Return the judgement of the take as HTML."""
    found = status.verdict
    said = found is not None and (found.words in status.message.text or found.words in status.question)
    return "" if found is None or said else sentence(found.words, "success" if found.success else "warning")


def numbers(status: SessionStatus) -> dict[str, str]:
    """Return the numbers of a session by their names."""
    found = {
        "take": f"seed {status.seed}, {status.time_s:.1f} s, {status.steps} steps",
        "contact, flat area": f"{100 * status.contact:.0f} %, {status.flat_area:.2f}",
    }
    if status.policy:
        found["policy"] = status.policy + (f", in control: {status.controller}" if status.controller else "")
    pulls = [f"your pull ({status.drag_steps} steps)"] if status.drag_steps else []
    if disturbed := ", ".join([*status.disturbances, *pulls]):
        found["disturbed by"] = disturbed
    if status.recording:
        found["kept"] = f"{status.progress}; {status.counts['discarded']} discarded; {status.n_episodes} in the file"
    found["speed"] = f"{status.real_time_factor:.1f} x real time" if status.real_time_factor else "-"
    return found
