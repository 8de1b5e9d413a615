"""SettingsPage: parts and speed of the simulation, and what is saved."""

from __future__ import annotations

from dataclasses import dataclass

import pygame

from layflat.app.workstation.settings import SPEEDS
from layflat.app.workstation.window import style
from layflat.app.workstation.window.context import KeyHint
from layflat.app.workstation.window.pages.page import Page, Shows
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.robots.registry import ROBOTS

ABOUT = (
    ("Robot", "hanger: a Panda arm holds the cloth by two clips and moves forward, back, up and down, as in chapter 4-3"
     " of the thesis. pickers: two free hands, one at each corner, three axes each (chapter 4-2)."),
    ("Cloth", "towel: 35 by 35 cm. napkin: 27.5 by 21.5 cm, thinner. towel-fine: the towel with a finer mesh, slower."),
    ("Descriptor", "How the direction in which the wrinkles contract is measured. Sessions and models have one each."),
    ("Speed", "Simulated over wall time, at most. Data are the same at any speed: a step is a step."),
    ("Camera noise", "The depth noise of a real camera. Perception is made for it; without it, images are cleaner than"
     " real ones ever are."),
    ("Save images", "Saves every step's camera image in the session, about 16 MB an episode."),
)  # fmt: skip


@dataclass
class SettingsPage(Page):
    """Page of settings; each is kept as soon as it is chosen."""

    name: str = "Settings"
    shows: Shows = "text"

    def build(self) -> None:
        """Make the menu."""
        now, form = self.context.settings, self.new_form("Settings")
        choices = {"robot": ROBOTS, "cloth": CLOTHS, "descriptor": DESCRIPTORS, "speed": SPEEDS}
        for name, known in choices.items():
            form.choice(name.capitalize(), list(known), getattr(now, name), self.setting(name))
        seconds = [f"{s} s" for s in (0, 1, 2, 3, 5)]
        form.choice("Countdown", seconds, f"{now.countdown_s:g} s", self._set_countdown)
        form.switch("Camera noise", now.noise, self.setting("noise"))
        form.switch("Save images", now.images, self.setting("images"))

    def _set_countdown(self, text: str) -> None:
        self.setting("countdown_s")(float(text.split()[0]))

    def leave(self) -> None:
        """Do nothing: nothing runs here."""

    def key_hints(self) -> list[KeyHint]:
        """Return the keys of the menu."""
        return [KeyHint("Enter", "choose in the menu"), KeyHint("arrows", "go up and down in it")]

    def draw_text(self, surface: pygame.Surface) -> None:
        """Draw an explanation of each setting."""
        surface.fill(style.BACKGROUND)
        style.draw_card(surface, surface.get_rect())
        inner = surface.get_rect().inflate(-40, -32)
        y = inner.top
        for name, sentence in (*ABOUT, ("Folder", f"Sessions and models: {self.context.folder}")):
            style.draw_text(surface, name, (inner.left, y), 15, style.TEXT, face=style.BOLD)
            rest = pygame.Rect(inner.left, y + 22, min(inner.width, 680), inner.bottom - y - 22)
            y = style.draw_block(surface, sentence, rest, 14, style.QUIET) + 14
