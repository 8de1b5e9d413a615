"""Settings: what the bench is made of, how fast it runs, what is kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import pygame

from layflat.app.workstation.window import menu_style, style
from layflat.app.workstation.window.pages.page import BasePage, KeyHint, Shows
from layflat.app.workstation.window.settings import SPEEDS, with_one
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.sim.cloth.spec import CLOTHS

ABOUT = (
    ("Robot", "hanger: a Panda arm holds the cloth by two clips and moves forth, back, up and down, as in chapter 4-3 "
     "of the thesis. pickers: two free hands, one at each corner, three axes each (chapter 4-2)."),
    ("Cloth", "towel: 35 by 35 cm. napkin: 27.5 by 21.5 cm, thinner. towel-fine: the towel with a finer mesh, slower."),
    ("Descriptor", "What says in which direction the wrinkles contract. A session has one, and so has a model."),
    ("Speed", "Simulated over wall time, at most. Data are the same at any speed: a step is a step."),
    ("Camera noise", "The depth noise of a real camera. Perception is made for it; without it things look cleaner than"
     " they ever are."),
    ("Keep images", "Every step's camera image goes into the session, about 16 MB an episode."),
)  # fmt: skip


@dataclass
class SettingsPage(BasePage):
    name: str = "Settings"
    shows: Shows = "text"

    def build(self) -> None:
        shop, width, now = self.shop, self.shop.place.panel.width, self.shop.settings
        self.menu = menu = menu_style.menu(shop.place.panel)
        menu_style.heading(menu, "Settings")
        known = {
            "robot": ["hanger", "pickers"], "cloth": list(CLOTHS), "descriptor": list(DESCRIPTORS),
            "speed": list(SPEEDS),
        }  # fmt: skip
        for name, values in known.items():
            menu_style.choice(menu, name.capitalize(), values, getattr(now, name), self._setter(name), width=width)
        seconds = [f"{s} s" for s in (0, 1, 2, 3, 5)]
        menu_style.choice(menu, "Countdown", seconds, f"{now.countdown_s:g} s", self._take_countdown, width=width)
        menu_style.switch(menu, "Camera noise", now.noise, self._setter("noise"))
        menu_style.switch(menu, "Keep images", now.images, self._setter("images"))

    def _setter(self, name: str) -> Any:
        return lambda value: self.shop.change(with_one(self.shop.settings, name, value))

    def _take_countdown(self, text: str) -> None:
        self.shop.change(replace(self.shop.settings, countdown_s=float(text.split()[0])))

    def leave(self) -> None:
        """Everything is remembered as it is chosen."""

    def chips(self) -> list[KeyHint]:
        return [KeyHint("Enter", "choose in the menu"), KeyHint("arrows", "go up and down in it")]

    def paint_text(self, surface: pygame.Surface) -> None:
        surface.fill(style.GROUND)
        style.card(surface, surface.get_rect())
        inner = surface.get_rect().inflate(-40, -32)
        y = inner.top
        for name, sentence in (*ABOUT, ("Folder", f"Sessions and models: {self.shop.folder}")):
            style.write(surface, name, (inner.left, y), 15, style.TEXT, face=style.BOLD)
            rest = pygame.Rect(inner.left, y + 22, min(inner.width, 680), inner.bottom - y - 22)
            y = style.write_block(surface, sentence, rest, 14, style.QUIET) + 14
