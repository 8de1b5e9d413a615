"""Record: a person demonstrates, one take after another, into one session."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import pygame

from layflat.app.workstation.session.intervention import YOU
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.window import menu_style, style
from layflat.app.workstation.window.input_manager import InputManager
from layflat.app.workstation.window.pages.page import ASK_AGAIN_S, BasePage, FormRow, KeyHint, device_chips
from layflat.app.workstation.window.settings import SOURCES, with_one
from layflat.data.session.reader import open_session
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES

STATES = {
    "waiting": ("Ready", style.TEXT),
    "countdown": ("Get ready", style.WORD),
    "running": ("Recording", style.RECORDING),
    "paused": ("Paused", style.WORD),
    "finished": ("Keep it?", style.ACCENT),
    "over": ("Over", style.QUIET),
}


@dataclass
class RecordPage(BasePage):
    """``disturbance`` is what the device's disturb button begins."""

    name: str = "Record"
    hands: InputManager | None = None
    seed: int = 0
    episodes: int | None = None
    disturbance: str = "push"
    correct: str = ""
    """Path of a model that places, and that the person takes over from; empty: they demonstrate."""
    running: bool = False
    _escaped_s: float = -ASK_AGAIN_S
    echo: bool = False
    """Lines of what was kept go to stdout as well."""

    def build(self) -> None:
        shop, width = self.shop, self.shop.place.panel.width
        self.menu = menu = menu_style.menu(shop.place.panel)
        menu_style.heading(menu, "Record")
        menu_style.note(menu, "Demonstrations are added to a session; what is in it stays.", width)
        known = {
            "source": [source for source in SOURCES if source != "scripted"],
            "robot": ["hanger", "pickers"],
            "cloth": list(CLOTHS),
        }
        for name, values in known.items():
            chosen = getattr(shop.settings, name)
            menu_style.choice(menu, name.capitalize(), values, chosen, self._setter(name), width=width)
        menu_style.entry(menu, "Session file", shop.settings.session, self._setter("session"), width=width)
        menu_style.entry(menu, "First seed", str(self.seed), self._take_seed, width=width)
        names = [name for name in DISTURBANCES if name != "none"]
        menu_style.choice(menu, "Disturb button", names, self.disturbance, self._take_disturbance, width=width)
        menu_style.button(menu, "Begin", self.start, main=True)
        shop.say(self._about_session())

    def _setter(self, name: str) -> Any:
        def take(value: str) -> None:
            self.shop.change(with_one(self.shop.settings, name, value.strip()))
            self.shop.say(self._about_session())

        return take

    def _take_seed(self, text: str) -> None:
        self.seed = int(text) if text.isdigit() and int(text) < 2**32 else self.seed

    def _take_disturbance(self, name: str) -> None:
        self.disturbance = name

    def _session(self) -> str:
        name = self.shop.settings.session or "demos.h5"
        return name if name.endswith(".h5") else f"{name}.h5"

    def _about_session(self) -> str:
        """What is in the session that is named."""
        path = self.shop.folder / self._session()
        if not path.exists():
            return f"{path.name} is new"
        try:
            with open_session(path) as session:
                count = "one demonstration" if len(session) == 1 else f"{len(session)} demonstrations"
                return f"{path.name} has {count}: {session.robot}, {session.cloth}"
        except (ValueError, OSError) as error:
            return str(error)

    def start(self) -> None:
        settings = self.shop.settings
        path = self.shop.folder / self._session()
        order = {
            "work": "record",
            **settings.bench(),
            "source": settings.source,
            "record": str(path),
            "seed": self.seed,
            "countdown_s": settings.countdown_s,
            "episodes": self.episodes,
            "disturbance": self.disturbance,
            "correct": self.correct,
        }
        if self.hands is not None and not self.hands.use(settings.source, order["robot"]):
            self.shop.say(self.hands.problem, style.WARNING)
            return
        self.menu, self.running = None, True
        self.past.episode = -1
        self.shop.link.moment = None
        self.shop.say("")
        self.shop.link.start(order, order["robot"])

    def stop(self) -> None:
        """Back to the menu, with everything kept."""
        last = self.shop.message
        for message in self.shop.link.end():
            last = self._hear(message) or last
        self._back(last)

    def _back(self, sentence: str, colour: style.Colour = style.QUIET) -> None:
        self.running, self.shop.link.status = False, {}
        if self.hands is not None:
            self.hands.drop()
        self.build()
        if sentence:
            self.shop.say(sentence, colour)

    def leave(self) -> None:
        for message in self.shop.link.end():
            self._hear(message)
        super().leave()
        self.running = False
        if self.hands is not None:
            self.hands.drop()

    def busy(self) -> str:
        status = self.shop.link.status
        return "the running demonstration and keep it as partial" if self.running and status.get("steps") else ""

    def hear(self, messages: list[dict[str, Any]]) -> None:
        """What the bench said; its end, whoever wanted it."""
        for message in messages:
            self._hear(message)
        if self.running and not self.shop.link.alive:
            sentence = self.shop.link.sentence
            self._back(sentence or self.shop.message, style.WARNING if sentence else style.QUIET)

    def _hear(self, message: dict[str, Any]) -> str:
        line = str(message.get("line", ""))
        if message["kind"] == "said":
            if self.echo:
                print(line, flush=True)
            self.shop.say(line, style.CONTACT if line.startswith("kept") else style.QUIET)
        return line

    def control(self, control: Command) -> None:
        self.shop.link.ask("control", name=control.name)

    def handle(self, event: pygame.event.Event) -> bool:
        if self.running and event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE:
            self.escape()
            return True
        return False

    def escape(self) -> None:
        """To the menu; of a demonstration that runs one is asked twice."""
        now = time.monotonic()
        if self.busy() and now - self._escaped_s > ASK_AGAIN_S:
            self._escaped_s = now
            self.shop.say(f"Esc would end {self.busy()}; once more does", style.WARNING)
        else:
            self.stop()

    def pullable(self) -> bool:
        leads = self.hands is not None and self.hands.leads()
        return self.running and not leads and self.shop.link.status.get("state") == "running"

    def chips(self) -> list[KeyHint]:
        if not self.running or self.hands is None:
            return [KeyHint("Enter", "choose and press in the menu"), KeyHint("mouse", "turn, zoom and shift the view")]
        does: dict[str, str | None] = self.shop.link.status.get("does", {})
        return [*device_chips(self.hands.help(), does, self.control), KeyHint("Esc", "to the menu", self.escape)]

    def headline(self) -> tuple[str, style.Colour]:
        status = self.shop.link.status
        if status.get("state") == "waiting" and not status.get("ready"):
            return "Hanging up…", style.QUIET
        if status.get("leads") == YOU:
            return "You lead", style.LED
        return STATES.get(str(status.get("state")), ("Starting…", style.QUIET))

    def rows(self) -> list[FormRow]:
        status, settings = self.shop.link.status, self.shop.settings
        counts: dict[str, int] = status.get("counts", {})
        kept = f"{counts.get('success', 0)} success, {counts.get('failure', 0)} failure"
        partial = counts.get("partial", 0)
        return [
            FormRow("demonstration", f"seed {status.get('seed', self.seed)}"),
            FormRow("time", f"{status.get('time_s', 0.0):.1f} s, {status.get('n_steps', 0)} steps"),
            FormRow("contact", f"{100 * status.get('contact', 0.0):.1f} %", style.CONTACT),
            FormRow("flat area", f"{status.get('flat_area', 0.0):.3f}"),
            FormRow("kept", kept + (f", {partial} partial" if partial else ""), style.CONTACT),
            FormRow("discarded", str(counts.get("discarded", 0))),
            FormRow("in the session", f"{status.get('stored', 0)} in {self._session()}"),
            FormRow("robot", f"{settings.robot}, {settings.cloth}, by {self._who()}"),
            FormRow("", str(status.get("message", "")), style.QUIET),
        ]

    def _who(self) -> str:
        """Whose demonstrations these are."""
        helped, source = self.shop.link.status.get("helped"), self.shop.settings.source
        return f"{helped}, corrected by {source}" if helped else source

    def banner(self) -> tuple[str, str]:
        status = self.shop.link.status
        state = status.get("state")
        if not self.running:
            return "", ""
        if state == "countdown":
            if not status.get("ready"):
                return "Hanging up the cloth", f"seed {status.get('seed')}"
            return f"{max(1, round(0.5 + status.get('countdown', 0.0) - 1e-6))}", "get ready"
        if state == "running" and status.get("awaits_motion"):
            if status.get("helped"):
                return "Stopped", str(status.get("message", ""))
            return "Go", "time runs with your first motion"
        if state == "paused":
            return "Paused", str(status.get("message", ""))
        if state == "finished":
            return "Keep it?", str(status.get("message", ""))
        if state == "waiting":
            return ("Ready" if status.get("ready") else "Hanging up the cloth"), self._first_press()
        return ("Starting the bench", "") if not status and self.shop.link.alive else ("", "")

    def _first_press(self) -> str:
        does = self.shop.link.status.get("does", {}).get("START")
        names = [button.name for button in self.hands.help() if button.control is Command.START] if self.hands else []
        return f"{names[0]}: {does}" if names and does else ""
