"""LivePanel: the session that runs, with what each button does now."""

from __future__ import annotations

from functools import partial

from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.web.viewer import Viewer
from layflat.app.workstation.web.widgets import facts, put, sentence
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
    Command.QUIT: ("Q", "gray"),
}
"""Key and colour of each command, in the order of the buttons."""
HEADLINES = {
    "starting": "Starting the simulation",
    "waiting": "Ready",
    "countdown": "Get ready",
    "still": "Go: time stands until you move",
    "running": "Running",
    "paused": "Paused",
    "stopped": "Stopped",
    "finished": "Keep it?",
    "asking": "A question",
    "over": "Ended",
}
PHASES = {"disturb": "Disturbed", "repair": "Repairing"}
LABELS = (Command.KEEP_SUCCESS, Command.KEEP_FAILURE, Command.DISCARD)
RARE = (Command.REDO, Command.UNDO, Command.DISTURB, Command.QUIT)
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
        self._facts = gui.add_html("")
        self.update()

    def close(self) -> None:
        """Take the keys away."""
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
    return sentence(status.message.text, status.message.level)


def verdict(status: SessionStatus) -> str:
    """Return the judgement of the take as HTML."""
    found = status.verdict
    return "" if found is None else sentence(found.words, "success" if found.success else "warning")


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
