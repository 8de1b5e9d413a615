"""RecordPage: a person records demonstrations, one after another, into one session."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import pygame

from layflat.app.workstation.session.requests import RecordRequest
from layflat.app.workstation.settings import SPEEDS
from layflat.app.workstation.teleop.registry import TELEOPERATORS
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.window import style
from layflat.app.workstation.window.context import FormRow, KeyHint, device_key_hints
from layflat.app.workstation.window.pages.activity import ActivityPage
from layflat.app.workstation.window.pages.page import ASK_AGAIN_S, MENU_HINTS
from layflat.data.session.reader import open_session
from layflat.policy.trained_model import TrainedModel
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import ROBOTS

STATES = {
    "waiting": ("Ready", style.TEXT),
    "countdown": ("Get ready", style.WORD),
    "running": ("Recording", style.RECORDING),
    "paused": ("Paused", style.WORD),
    "finished": ("Keep it?", style.ACCENT),
    "over": ("Ended", style.QUIET),
}


@dataclass
class RecordPage(ActivityPage):
    """Page of `layflat record` by a person."""

    name: str = "Record"
    episodes: int | None = None
    """Number of episodes to keep; None: until the person quits."""
    disturbance: str = "push"
    """Disturbance that the device's disturb button starts."""
    model: TrainedModel | None = None
    """Policy that places and that the person takes over from; None: they demonstrate."""
    print_lines: bool = False
    """Whether lines about episodes go to stdout, too."""
    _escaped_s: float = -ASK_AGAIN_S

    def build(self) -> None:
        """Make the menu."""
        now, form = self.context.settings, self.new_form("Record")
        form.note("Demonstrations are added to a session; those already in it stay.")
        for name, known in {"source": TELEOPERATORS, "robot": ROBOTS, "cloth": CLOTHS}.items():
            form.choice(name.capitalize(), list(known), getattr(now, name), self.setting(name))
        form.entry("Session file", now.session, self.setting("session"))
        form.entry("First seed", str(self.seed), self.set_seed)
        disturbances = [name for name in DISTURBANCES if name != "none"]
        form.choice("Disturb button", disturbances, self.disturbance, self._set_disturbance)
        form.button("Start", self.start, main=True)
        self._describe_session()

    def setting(self, name: str) -> Any:
        """Return a function that changes a setting, and then describes the session."""
        change = super().setting(name)

        def change_and_describe(value: str) -> None:
            change(value)
            self._describe_session()

        return change_and_describe

    def _set_disturbance(self, name: str) -> None:
        self.disturbance = name

    def _session_name(self) -> str:
        name = self.context.settings.session or "demos.h5"
        return name if name.endswith(".h5") else f"{name}.h5"

    def _describe_session(self) -> None:
        path = self.context.folder / self._session_name()
        if not path.exists():
            self.context.show_message(f"{path.name} is new")
            return
        try:
            with open_session(path) as session:
                count = "one demonstration" if len(session) == 1 else f"{len(session)} demonstrations"
                self.context.show_message(f"{path.name} has {count}: {session.robot}, {session.cloth}")
        except (ValueError, OSError) as error:
            self.context.show_message(str(error))

    def start(self) -> None:
        """Start the recording."""
        settings = self.context.settings
        request = RecordRequest(
            sim_config=settings.sim_config(),
            seed=self.seed,
            speed=SPEEDS[settings.speed],
            images=settings.images,
            source=settings.source,
            session=self.context.folder / self._session_name(),
            countdown_s=settings.countdown_s,
            episodes=self.episodes,
            disturbance=self.disturbance,
            model=self.model,
        )
        if self.run(request):
            self.context.show_message("")

    def busy(self) -> str:
        """Return what would be ended by leaving."""
        steps = self.running and self.status.get("steps")
        return "the running demonstration and keep it as partial" if steps else ""

    def handle_activity_event(self, event: dict[str, Any]) -> None:
        """Show lines about episodes."""
        if event["event"] == "line":
            line = str(event["line"])
            if self.print_lines:
                print(line, flush=True)
            self.context.show_message(line, style.CONTACT if line.startswith("kept") else style.QUIET)

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Handle Esc."""
        if self.running and event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE:
            self.escape()
            return True
        return False

    def escape(self) -> None:
        """Go to the menu; a running demonstration is only ended on a second request."""
        now = time.monotonic()
        if self.busy() and now - self._escaped_s > ASK_AGAIN_S:
            self._escaped_s = now
            self.context.show_message(f"Esc would end {self.busy()}; press it again to do so", style.WARNING)
        else:
            self.stop()

    def accepts_drag(self) -> bool:
        """Return whether the mouse may drag the cloth now."""
        return self.can_drag("running")

    def key_hints(self) -> list[KeyHint]:
        """Return the effect of each button of the device now."""
        if not self.running:
            return list(MENU_HINTS)
        effects: dict[str, str | None] = self.status.get("effects", {})
        hints = device_key_hints(self.input_manager.help(), effects, self.context.send_command)
        hints.insert(sum(hint.press is not None for hint in hints), KeyHint("Esc", "to the menu", self.escape))
        return hints

    def headline(self) -> tuple[str, style.Color]:
        """Return the state."""
        if self.state == "waiting" and not self.status.get("ready"):
            return "Hanging the cloth…", style.QUIET
        if self.human_in_control:
            return "You are in control", style.HUMAN
        return STATES.get(self.state, ("Starting…", style.QUIET))

    def rows(self) -> list[FormRow]:
        """Return numbers of the demonstration and of the recording."""
        status, settings = self.status, self.context.settings
        counts: dict[str, int] = status.get("counts", {})
        kept = f"{counts.get('success', 0)} success, {counts.get('failure', 0)} failure"
        partial = counts.get("partial", 0)
        policy, source = status.get("assisted_policy"), settings.source
        by = f"{policy}, corrected by {source}" if policy else source
        return [
            FormRow("demonstration", f"seed {status.get('seed', self.seed)}"),
            FormRow("time", f"{status.get('time_s', 0.0):.1f} s, {status.get('steps', 0)} steps"),
            FormRow("contact", f"{100 * status.get('contact', 0.0):.1f} %", style.CONTACT),
            FormRow("flat area", f"{status.get('flat_area', 0.0):.3f}"),
            FormRow("kept", kept + (f", {partial} partial" if partial else ""), style.CONTACT),
            FormRow("discarded", str(counts.get("discarded", 0))),
            FormRow("in the session", f"{status.get('n_episodes', 0)} in {self._session_name()}"),
            FormRow("robot", f"{settings.robot}, {settings.cloth}, by {by}"),
            FormRow("", str(status.get("message", "")), style.QUIET),
        ]

    def banner(self) -> tuple[str, str]:
        """Return what the person should do now."""
        status, message = self.status, str(self.status.get("message", ""))
        ready = bool(status.get("ready"))
        if not self.running:
            return "", ""
        if self.state == "countdown":
            left_s = float(status.get("countdown", 0.0))
            seconds = max(1, round(0.5 + left_s - 1e-6))
            return (str(seconds), "get ready") if ready else ("Hanging the cloth", f"seed {status.get('seed')}")
        if self.state == "running" and status.get("waiting_for_motion"):
            return ("Stopped", message) if status.get("assisted_policy") else ("Go", "starts when you move")
        if self.state in ("paused", "finished"):
            return STATES[self.state][0], message
        if self.state == "waiting":
            return ("Ready" if ready else "Hanging the cloth"), self._start_hint()
        return ("Starting the simulation", "") if not status and self.context.client.alive else ("", "")

    def _start_hint(self) -> str:
        effect = self.status.get("effects", {}).get(Command.START.name)
        names = [button.name for button in self.input_manager.help() if button.command is Command.START]
        return f"{names[0]}: {effect}" if names and effect else ""
