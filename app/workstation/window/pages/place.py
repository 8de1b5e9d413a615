"""Place and Disturb: a policy lays the cloth; whoever watches may pull at it or disturb it at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pygame

from layflat.app.workstation.session.intervention import YOU
from layflat.app.workstation.teleop import Command
from layflat.app.workstation.teleop.registry import TELEOPERATORS
from layflat.app.workstation.window import menu_style, style
from layflat.app.workstation.window.input_manager import InputManager
from layflat.app.workstation.window.pages.page import BasePage, FormRow, KeyHint, device_chips
from layflat.app.workstation.window.settings import with_one
from layflat.policy import model_io as model_files
from layflat.policy.registry import BUILTIN_POLICIES, RECOMMENDED_WRAPPERS
from layflat.policy.spec import SCRIPTED
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES

NAMED = tuple(name for name in DISTURBANCES if name != "none")
"""Disturbances in the order of the keys."""
DIGITS = "1234567890-="
"""Keys that begin them; more of them than keys can be clicked at."""
NOBODY = "nobody"
HELP = {"nothing": (), **{name: (name,) for name in RECOMMENDED_WRAPPERS}, "both": RECOMMENDED_WRAPPERS}
"""What can be around who decides, by what the menu calls it."""
STATES = {
    "ready": ("Ready", style.TEXT),
    "placing": ("Placing", style.ACCENT),
    "placed": ("Placed", style.CONTACT),
    "disturbing": ("Disturbed", style.WARNING),
    "repairing": ("Repairing", style.WORD),
    "over": ("Over", style.WARNING),
}


@dataclass
class PlacePage(BasePage):
    """``hurry``: the cloth is laid as fast as it goes, and then waits to be disturbed (the Disturb tab).

    With ``hands`` a person may take over, by the device ``source``.
    """

    name: str = "Place"
    hands: InputManager | None = None
    source: str = NOBODY
    help: str = "nothing"
    hurry: bool = False
    seed: int = 0
    record: str = ""
    running: bool = False
    finished: bool = False

    def build(self) -> None:
        shop, width = self.shop, self.shop.place.panel.width
        self.menu = menu = menu_style.menu(shop.place.panel)
        menu_style.heading(menu, self.name)
        about = "Lays the cloth quickly, then it is yours to disturb." if self.hurry else "A policy lays the cloth."
        menu_style.note(menu, about, width)
        known = [*shop.models(), SCRIPTED, *BUILTIN_POLICIES]
        chosen = shop.settings.model if shop.settings.model in known else known[0]
        menu_style.choice(menu, "Who decides: a model, or a rule", known, chosen, self._choose, width=width)
        self._choose(chosen)
        if not chosen.endswith(".npz"):
            self._bench_choices(menu, width)
        if self.hands is not None:
            sources = [NOBODY, *TELEOPERATORS]
            menu_style.choice(menu, "Who may take over", sources, self.source, self._take_source, width=width)
        about = "Help against folds and swinging"
        menu_style.choice(menu, about, list(HELP), self.help, self._take_help, width=width)
        menu_style.entry(menu, "Seed of the start", str(self.seed), self._take_seed, width=width)
        menu_style.entry(menu, "Record into (empty: nowhere)", self.record, self._take_record, width=width)
        menu_style.button(menu, "Lay and disturb" if self.hurry else "Place", self.start, main=True)

    def _bench_choices(self, menu: Any, width: int) -> None:
        """A model brings its robot and cloth with it; a rule does not."""
        for name, known in (("robot", ["hanger", "pickers"]), ("cloth", list(CLOTHS))):
            value = getattr(self.shop.settings, name)
            menu_style.choice(menu, name.capitalize(), known, value, self._setter(name), width=width)

    def _setter(self, name: str) -> Any:
        return lambda value: self.shop.change(with_one(self.shop.settings, name, value))

    def _choose(self, policy: str) -> None:
        was = self.shop.settings.model
        self.shop.change(replace(self.shop.settings, model=policy))
        if was.endswith(".npz") != policy.endswith(".npz") and was:
            self.shop.link.moment = None
            self._rebuild = True

    _rebuild: bool = False
    _told: str | None = None
    """What the bench said last."""

    def _take_source(self, name: str) -> None:
        self.source = name

    def _take_help(self, name: str) -> None:
        self.help = name

    def _take_seed(self, text: str) -> None:
        self.seed = int(text) if text.isdigit() and int(text) < 2**32 else self.seed

    def _take_record(self, text: str) -> None:
        self.record = text.strip()

    def start(self) -> None:
        """Begin a bench process for this seed."""
        order = self._order()
        if order is None or not self._take_hands(order):
            return
        self.menu, self.running, self.finished = None, True, False
        self.past.episode, self._told = -1, None
        self.shop.link.moment = None
        self.shop.link.start(order, order["robot"])
        self.shop.link.ask("start")
        self.shop.say(f"hanging up the cloth of seed {self.seed}")

    def _take_hands(self, order: dict[str, Any]) -> bool:
        """Take the device into the hands, and into the order; False where it cannot be had (which is said)."""
        if self.hands is None or self.source == NOBODY:
            return True
        order["source"] = self.source
        if not self.hands.use(self.source, order["robot"]):
            self.shop.say(self.hands.problem, style.WARNING)
            return False
        return True

    def _drop_hands(self) -> None:
        if self.hands is not None:
            self.hands.drop()

    def _order(self) -> dict[str, Any] | None:
        """What the bench is told, or None where the model cannot be read (which is said)."""
        settings, policy = self.shop.settings, self.shop.settings.model
        order: dict[str, Any] = {"work": "place", **settings.bench(), "seed": self.seed, "hurry": self.hurry}
        order["with"] = list(HELP[self.help])
        if policy.endswith(".npz"):
            path = self.shop.folder / policy
            try:
                model = model_files.load(path)
            except (ValueError, OSError) as error:
                self.shop.say(str(error), style.WARNING)
                return None
            order |= {"policy": str(path), "robot": model.layout.robot, "cloth": model.cloth}
        else:
            order["policy"] = policy or SCRIPTED
        if self.record:
            name = self.record if self.record.endswith(".h5") else f"{self.record}.h5"
            order["record"] = str(self.shop.folder / name)
        return order

    def stop(self) -> None:
        """Back to the menu."""
        for message in self.shop.link.end():
            self._hear(message)
        self._back()

    def _back(self) -> None:
        self.running, self.shop.link.status = False, {}
        self._drop_hands()
        self.build()

    def leave(self) -> None:
        super().leave()
        self.running = False
        self._drop_hands()

    def busy(self) -> str:
        recording = self.running and self.record and self.shop.link.status.get("steps")
        return "the recorded placing, whose steps would be kept as partial" if recording and not self.finished else ""

    def update(self) -> None:
        super().update()
        told = self.shop.link.status.get("message")
        if self.running and not self.finished and told is not None and told != self._told:
            self._told = told
            self.shop.say(told)
        if self._rebuild and self.menu is not None:
            self._rebuild = False
            self.build()

    def hear(self, messages: list[dict[str, Any]]) -> None:
        """What the bench said."""
        for message in messages:
            self._hear(message)
        if self.running and not self.shop.link.alive and not self.finished:
            if self.shop.link.sentence:
                self.shop.say(self.shop.link.sentence, style.WARNING)
            self._back()

    def _hear(self, message: dict[str, Any]) -> None:
        if message["kind"] in ("kept", "discarded"):
            self.finished = True
            self._drop_hands()
            self.shop.say(message["line"], style.CONTACT if message["kind"] == "kept" else style.QUIET)

    def again(self) -> None:
        """The next seed."""
        for message in self.shop.link.end():
            self._hear(message)
        self.seed += 1
        self.start()

    def handle(self, event: pygame.event.Event) -> bool:
        if event.type != pygame.KEYDOWN or not self.running:
            return False
        acts = {
            pygame.K_SPACE: self._pause,
            pygame.K_k: lambda: self.shop.link.ask("keep"),
            pygame.K_x: lambda: self.shop.link.ask("discard"),
            pygame.K_n: self.again,
            pygame.K_ESCAPE: self.stop,
        }
        digit = chr(event.key) if 0 < event.key < 128 else ""
        if digit and digit in DIGITS[: len(NAMED)]:
            self.shop.link.ask("disturb", name=NAMED[DIGITS.index(digit)])
            return True
        if event.key in acts:
            acts[event.key]()
            return True
        return False

    def _pause(self) -> None:
        self.shop.link.ask("pause")

    def pullable(self) -> bool:
        leads = self.hands is not None and self.hands.leads()
        return self.running and not leads and not self.finished and self._state() not in ("ready", "over", "")

    def _state(self) -> str:
        return str(self.shop.link.status.get("state", ""))

    def chips(self) -> list[KeyHint]:
        if not self.running:
            return [KeyHint("Enter", "choose and press in the menu"), KeyHint("mouse", "turn, zoom and shift the view")]
        # Where keys are a person's device they go to that, and what they do else is clicked at.
        keyed = self.source in (NOBODY, "gamepad") or self.finished
        chips = [] if self.finished else self._acting_chips()
        chips += [
            KeyHint("N" if keyed else "•", "next seed", self.again),
            KeyHint("Esc", "end, to the menu", self.stop),
        ]
        if not self.finished:
            if self.hands is None or not self.hands.leads():
                chips.append(KeyHint("drag", "pull at the cloth"))
            for k, name in enumerate(NAMED):
                key = DIGITS[k] if keyed and k < len(DIGITS) else "•"
                chips.append(KeyHint(key, name, self._disturber(name), style.WORD))
        return chips

    def _acting_chips(self) -> list[KeyHint]:
        """What becomes of the episode, by keys or by the buttons of the person's device."""
        status, ask = self.shop.link.status, self.shop.link.ask
        if self.hands is not None and self.source != NOBODY:
            return device_chips(self.hands.help(), status.get("does", {}), self._control)
        chips = [KeyHint("Space", "go on" if status.get("paused") else "pause", self._pause)]
        if status.get("recording"):
            chips.append(KeyHint("K", "keep", lambda: ask("keep"), style.CONTACT))
            chips.append(KeyHint("X", "discard", lambda: ask("discard"), style.WARNING))
        return chips

    def _control(self, control: Command) -> None:
        self.shop.link.ask("control", name=control.name)

    def _disturber(self, name: str) -> Callable[[], None]:
        return lambda: self.shop.link.ask("disturb", name=name)

    def headline(self) -> tuple[str, style.Colour]:
        if self.finished:
            return "Finished", style.CONTACT
        if self.shop.link.status.get("paused"):
            return "Paused", style.WORD
        if self.shop.link.status.get("leads") == YOU:
            return "You lead", style.LED
        return STATES.get(self._state(), ("Hanging up…", style.QUIET))

    def rows(self) -> list[FormRow]:
        status, moment = self.shop.link.status, self.moment()
        rows = [
            FormRow("policy", str(status.get("policy", Path(self.shop.settings.model).stem))),
            FormRow("seed", str(self.seed)),
            FormRow("time", "" if moment is None else f"{moment.sim_s:.1f} s, {moment.step} steps"),
            FormRow("contact", "" if moment is None else f"{100 * moment.contact:.1f} %", style.CONTACT),
            FormRow("flat area", "" if moment is None else f"{moment.flat_area:.3f}"),
            FormRow("disturbed by", ", ".join(self._befell()) or "nothing so far", style.WORD),
        ]
        if moment is not None:
            rows.append(FormRow("force", f"{sum(f * f for f in moment.force_n) ** 0.5:.2f} N", style.WARNING))
        if status.get("does"):
            rows.append(FormRow("you led in", f"{status.get('led_steps', 0)} steps", style.LED))
        rows.append(FormRow("recorded into", self.record or "nowhere"))
        return rows

    def _befell(self) -> list[str]:
        status = self.shop.link.status
        pulled = int(status.get("pulled_steps", 0))
        return [*status.get("disturbances", []), *([f"your hand ({pulled} steps)"] if pulled else [])]

    def banner(self) -> tuple[str, str]:
        if self.running and not self.shop.link.status and self.shop.link.alive:
            return "Hanging up the cloth", f"seed {self.seed}"
        if self.running and self.shop.link.status.get("paused"):
            message = str(self.shop.link.status.get("message", ""))
            return "Paused", message if message.startswith("paused") else "Space goes on"
        return "", ""
