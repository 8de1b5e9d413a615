"""Place and Disturb: a policy lays the cloth; whoever watches may pull at it or disturb it at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pygame

from app.workstation import look, theme
from app.workstation.modes.mode import BasicMode, Chip, Row
from app.workstation.placing import SCRIPTED
from app.workstation.settings import with_one
from policy import model as model_files
from policy.registry import MADE
from sim.cloth import CLOTHS
from sim.disturbances import DISTURBANCES

NAMED = tuple(name for name in DISTURBANCES if name != "none")
"""Disturbances in the order of the keys."""
DIGITS = "1234567890-="
"""Keys that begin them; more of them than keys can be clicked at."""
STATES = {
    "ready": ("Ready", look.TEXT),
    "placing": ("Placing", look.ACCENT),
    "placed": ("Placed", look.CONTACT),
    "disturbing": ("Disturbed", look.WARNING),
    "repairing": ("Repairing", look.WORD),
    "over": ("Over", look.WARNING),
}


@dataclass
class PlaceMode(BasicMode):
    """``hurry``: the cloth is laid as fast as it goes, and then waits to be disturbed (the Disturb tab)."""

    name: str = "Place"
    hurry: bool = False
    seed: int = 0
    record: str = ""
    running: bool = False
    finished: bool = False

    def build(self) -> None:
        shop, width = self.shop, self.shop.place.panel.width
        self.menu = menu = theme.menu(shop.place.panel)
        theme.heading(menu, self.name)
        about = (
            "Lays the cloth quickly, then it is yours to disturb." if self.hurry else "A policy lays the cloth alone."
        )
        theme.note(menu, about, width)
        known = [*shop.models(), SCRIPTED, *MADE]
        chosen = shop.settings.model if shop.settings.model in known else known[0]
        theme.choice(menu, "Who decides: a model, or a rule", known, chosen, self._choose, width=width)
        self._choose(chosen)
        if not chosen.endswith(".npz"):
            self._bench_choices(menu, width)
        theme.entry(menu, "Seed of the start", str(self.seed), self._take_seed, width=width)
        theme.entry(menu, "Record into (empty: nowhere)", self.record, self._take_record, width=width)
        theme.button(menu, "Lay and disturb" if self.hurry else "Place", self.start, main=True)

    def _bench_choices(self, menu: Any, width: int) -> None:
        """A model brings its task and cloth with it; a rule does not."""
        for name, known in (("task", ["hanger", "pickers"]), ("cloth", list(CLOTHS))):
            value = getattr(self.shop.settings, name)
            theme.choice(menu, name.capitalize(), known, value, self._setter(name), width=width)

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

    def _take_seed(self, text: str) -> None:
        self.seed = int(text) if text.isdigit() and int(text) < 2**32 else self.seed

    def _take_record(self, text: str) -> None:
        self.record = text.strip()

    def start(self) -> None:
        """Begin a bench process for this seed."""
        order = self._order()
        if order is None:
            return
        self.menu, self.running, self.finished = None, True, False
        self.past.episode, self._told = -1, None
        self.shop.link.moment = None
        self.shop.link.start(order, order["task"])
        self.shop.link.ask("start")
        self.shop.say(f"hanging up the cloth of seed {self.seed}")

    def _order(self) -> dict[str, Any] | None:
        """What the bench is told, or None where the model cannot be read (which is said)."""
        settings, policy = self.shop.settings, self.shop.settings.model
        order: dict[str, Any] = {"work": "place", **settings.bench(), "seed": self.seed, "hurry": self.hurry}
        if policy.endswith(".npz"):
            path = self.shop.folder / policy
            try:
                model = model_files.load(path)
            except (ValueError, OSError) as error:
                self.shop.say(str(error), look.WARNING)
                return None
            order |= {"policy": str(path), "task": model.layout.task, "cloth": model.cloth}
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
        self.running, self.shop.link.status = False, {}
        self.build()

    def leave(self) -> None:
        super().leave()
        self.running = False

    def busy(self) -> str:
        recording = self.running and self.record and self.shop.link.status.get("ticks")
        return "the recorded placing, whose ticks would be kept as partial" if recording and not self.finished else ""

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
            sentence = self.shop.link.sentence
            self.running = False
            if sentence:
                self.shop.say(sentence, look.WARNING)
            self.build()

    def _hear(self, message: dict[str, Any]) -> None:
        if message["kind"] in ("kept", "discarded"):
            self.finished = True
            self.shop.say(message["line"], look.CONTACT if message["kind"] == "kept" else look.QUIET)

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
        return self.running and not self.finished and self._state() not in ("ready", "over", "")

    def _state(self) -> str:
        return str(self.shop.link.status.get("state", ""))

    def chips(self) -> list[Chip]:
        if not self.running:
            return [Chip("Enter", "choose and press in the menu"), Chip("mouse", "turn, zoom and shift the view")]
        status = self.shop.link.status
        chips = []
        if not self.finished:
            chips.append(Chip("Space", "go on" if status.get("paused") else "pause", self._pause))
            if status.get("recording"):
                chips.append(Chip("K", "keep", lambda: self.shop.link.ask("keep"), look.CONTACT))
                chips.append(Chip("X", "discard", lambda: self.shop.link.ask("discard"), look.WARNING))
        chips += [Chip("N", "next seed", self.again), Chip("Esc", "end, to the menu", self.stop)]
        if not self.finished:
            chips.append(Chip("drag", "pull at the cloth"))
            for k, name in enumerate(NAMED):
                chips.append(Chip(DIGITS[k] if k < len(DIGITS) else "•", name, self._disturber(name), look.WORD))
        return chips

    def _disturber(self, name: str) -> Callable[[], None]:
        return lambda: self.shop.link.ask("disturb", name=name)

    def headline(self) -> tuple[str, look.Colour]:
        if self.finished:
            return "Finished", look.CONTACT
        if self.shop.link.status.get("paused"):
            return "Paused", look.WORD
        return STATES.get(self._state(), ("Hanging up…", look.QUIET))

    def rows(self) -> list[Row]:
        status, moment = self.shop.link.status, self.moment()
        rows = [
            Row("policy", str(status.get("policy", Path(self.shop.settings.model).stem))),
            Row("seed", str(self.seed)),
            Row("time", "" if moment is None else f"{moment.sim_s:.1f} s, {moment.tick} ticks"),
            Row("contact", "" if moment is None else f"{100 * moment.contact:.1f} %", look.CONTACT),
            Row("flat area", "" if moment is None else f"{moment.flat_area:.3f}"),
            Row("disturbed by", ", ".join(self._befell()) or "nothing so far", look.WORD),
        ]
        if moment is not None:
            rows.append(Row("force", f"{sum(f * f for f in moment.force_n) ** 0.5:.2f} N", look.WARNING))
        rows.append(Row("recorded into", self.record or "nowhere"))
        return rows

    def _befell(self) -> list[str]:
        status = self.shop.link.status
        pulled = int(status.get("pulled_ticks", 0))
        return [*status.get("disturbances", []), *([f"your hand ({pulled} ticks)"] if pulled else [])]

    def banner(self) -> tuple[str, str]:
        if self.running and not self.shop.link.status and self.shop.link.alive:
            return "Hanging up the cloth", f"seed {self.seed}"
        if self.running and self.shop.link.status.get("paused"):
            return "Paused", "Space goes on"
        return "", ""
