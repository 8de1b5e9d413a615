"""LivePage: a form until a session runs, and then the session, with what each button does now."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import Mode, SessionStatus
from layflat.app.workstation.settings import SPEEDS
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.web.viewer import Page
from layflat.app.workstation.web.widgets import facts, put, sentence
from layflat.data.arrays import FloatArray
from layflat.data.format import schema
from layflat.data.session.reader import open_session
from layflat.sim.disturbances.presets import DISTURBANCES

NEW, NONE = "new session", "none"
DISTURBED = tuple(name for name in DISTURBANCES if name != NONE)
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
"""Key and color of each command, in the order of the buttons."""
LABELS = (Command.KEEP_SUCCESS, Command.KEEP_FAILURE, Command.DISCARD)
RARE = (Command.REDO, Command.UNDO, Command.DISTURB)
"""Commands whose buttons are below the others, and only there while they have an effect."""
HEADLINES = {
    "starting": "Starting the simulation", "waiting": "Ready", "still": "Go", "paused": "Paused", "stopped": "Stopped",
    "finished": "Keep it?", "asking": "A question", "over": "Ended",
}  # fmt: skip
PHASES = {"disturb": "Disturbed", "repair": "Repairing"}


class LivePage(Page):
    """Base of the pages that run a session."""

    modes: tuple[Mode, ...] = ()
    """Sessions that the page shows."""
    preview: SimulationFrame | None = None
    """What the form would start."""
    _touched = False
    """Whether a choice of the form was changed since something ran."""
    _keys: Sequence[Any] = ()
    """Hotkeys of the running session."""

    def build_form(self) -> None:
        """Add the form."""

    def build(self) -> None:
        """Add the form, or the running session."""
        session = self.workstation.session
        self.close()
        self._alive = session.alive
        if not session.alive:
            self.build_form()
            self._touched = False
        elif session.status.mode in self.modes:
            self._build_panel()
        else:
            self.note("Another session is running; end it on its page before you start one here.")

    def _build_panel(self) -> None:
        gui, viewer = self.gui, self.viewer
        self._headline = gui.add_html("")
        self._answer = gui.add_button_group("Answer", ("Yes", "No"), visible=False)
        viewer.on_click(
            self._answer, lambda: self.workstation.session.answer(self._answer.value == "Yes"), control=True
        )
        self._buttons, self._keys = {}, []
        for command, (key, color) in COMMANDS.items():
            name, send = command.value.capitalize(), partial(self._send, command)
            self._buttons[command] = gui.add_button(name, color=color, disabled=True)  # type: ignore[arg-type]
            viewer.on_click(self._buttons[command], send, control=True)
            hotkey = gui.add_command(name, hotkey=key)  # type: ignore[arg-type]
            hotkey.on_trigger(viewer.reaction(send, control=True))
            self._keys.append(hotkey)
        self._disturb = gui.add_button_group("Disturb", DISTURBED, visible=False)
        viewer.on_click(self._disturb, self._send_disturbance, control=True)
        self._ghost = gui.add_checkbox("Ghost of the best end", False, visible=False)
        viewer.on_change(self._ghost, self._show_ghost)
        self._facts = gui.add_html("")
        hint = "Ends it; a running take is kept as partial."
        self.button("End", self.workstation.stop, control=True, color="gray", hint=hint)
        self._update_panel()

    def _send(self, command: Command) -> None:
        if self.workstation.session.status.effect(command) is not None:
            self.workstation.session.send_command(command)

    def _send_disturbance(self) -> None:
        if self._disturb.value in DISTURBED:
            self.workstation.session.disturb(str(self._disturb.value))

    def _show_ghost(self) -> None:
        """Show how the cloth lies at the end of the best success of the session."""
        request = self.workstation.session.request
        if not self._ghost.value or request is None or request.session is None:
            self.viewer.scene.show_ghost(None)
        else:
            self.viewer.background(partial(best_end, request.session), self.viewer.scene.show_ghost)

    def _update_panel(self) -> None:
        status = self.workstation.session.status
        put(self._headline, content=_headline(status))
        put(self._answer, visible=bool(status.question))
        for command, button in self._buttons.items():
            effect = status.effect(command)
            label = (effect or command.value).capitalize()
            visible = status.recording if command in LABELS else effect is not None or command not in RARE
            put(button, label=f"{label} ({COMMANDS[command][0]})", disabled=effect is None, visible=visible)
        put(self._disturb, visible=status.can_disturb)
        put(self._ghost, visible=status.recording)
        put(self._facts, content=facts(_numbers(status)))
        self.viewer.monitor(self.workstation.session.frame, self.workstation.series)

    def update(self) -> None:
        """Show the newest status, and the form again when the session has ended."""
        if self._alive != self.workstation.session.alive:
            self.viewer.rebuild()
        elif self._keys:
            self._update_panel()

    def frames(self) -> Sequence[SimulationFrame]:
        """Return what runs; else what has just ended, or would be started."""
        session = self.workstation.session
        if self.preview is None or session.alive or (session.frame is not None and not self._touched):
            return super().frames()
        return (self.preview,)

    def close(self) -> None:
        """Take keys and ghost away."""
        if self._keys:
            self.viewer.scene.show_ghost(None)
        for hotkey in self._keys:
            hotkey.remove()
        self._keys = ()

    def start(self, **request: Any) -> None:
        """Start a session with the workstation's settings."""
        self.viewer.say("")
        settings = self.workstation.settings
        speed, images = SPEEDS[settings.speed], settings.images
        self.workstation.start(SessionRequest(speed=speed, images=images, countdown_s=settings.countdown_s, **request))


def best_end(path: Path) -> FloatArray:
    """Return the nodes (N, 3) m at the end of the flattest success of a session."""
    with open_session(path) as session:
        flat = {name: session.info(name).flat_area_final or 0.0 for name in session.select(outcome="success")}
        if not flat:
            raise LayflatError(f"{path.name} has no success yet, whose end could be shown")
        return session.array(max(flat, key=lambda name: flat[name]), schema.FINAL_STATE).reshape(-1, 3)


def seed_of(text: str) -> int | None:
    """Return the seed that a person wrote, or None for an empty text; UsageError for anything else."""
    if not text.strip():
        return None
    if not text.strip().isdecimal() or int(text) >= 2**32:
        raise UsageError(f"the seed is {text!r}; it must be a whole number from 0 to {2**32 - 1}")
    return int(text)


def _headline(at: SessionStatus) -> str:
    """Return state, message, verdict and question as HTML, each thing once."""
    state = HEADLINES.get(at.state, "")
    if at.state == "countdown":
        state = f"Get ready: {at.countdown_s:.0f}"
    elif at.state == "waiting" and not at.ready:
        state = f"Hanging the cloth of seed {at.seed}"
    elif at.state == "running":
        state = PHASES.get(at.phase, "Placing" if at.policy else "Recording")
        state = "You are in control" if at.controller == "you" and at.policy else state
    said = f"<b>{sentence(state, 'warning' if at.state in ('paused', 'asking') else 'info')}</b>"
    if at.message.text.lower() not in (state.lower(), at.question.lower()):
        said += sentence(at.message.text, at.message.level)
    if at.verdict is not None and at.verdict.words not in at.message.text + at.question:
        said += sentence(at.verdict.words, "success" if at.verdict.success else "warning")
    return said + sentence(at.question, "warning")


def _numbers(at: SessionStatus) -> dict[str, str]:
    """Return the numbers of a session by their names."""
    found = {
        "take": f"seed {at.seed}, {at.time_s:.1f} s, {at.steps} steps",
        "contact, flat area": f"{100 * at.contact:.0f} %, {at.flat_area:.2f}",
    }
    if at.policy:
        found["policy"] = at.policy + (f", in control: {at.controller}" if at.controller else "")
    pulls = [f"your pull ({at.drag_steps} steps)"] if at.drag_steps else []
    if disturbed := ", ".join([*at.disturbances, *pulls]):
        found["disturbed by"] = disturbed
    if at.recording:
        found["kept"] = f"{at.progress}; {at.counts['discarded']} discarded; {at.n_episodes} in the file"
    found["speed"] = f"{at.real_time_factor:.1f} x real time" if at.real_time_factor else "-"
    return found
