"""Train: demonstrations in, a model out, in the background."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from layflat.app.workstation.window import menu_style
from layflat.app.workstation.window.pages.command import CommandPage
from layflat.policy.registry import TRAINABLE_POLICIES

INTRO = (
    "Learns a policy from the successful demonstrations of a session and writes it as a model.",
    "gp-word sees the cloth: how much of it lies on the table, and in which direction its wrinkles contract. "
    "gp-baseline sees only where the holder is.",
    "A few demonstrations are enough; training takes seconds to a minute. You may go to another tab meanwhile.",
)


@dataclass
class TrainPage(CommandPage):
    name: str = "Train"
    session: str = ""
    model: str = ""
    replace_model: bool = False
    intro: tuple[str, ...] = INTRO
    _noted: bool = False

    def build(self) -> None:
        shop, width = self.shop, self.shop.place.panel.width
        self.menu = menu = menu_style.menu(shop.place.panel)
        menu_style.heading(menu, "Train")
        sessions = shop.sessions()
        if not sessions:
            menu_style.note(menu, f"There is no session in {shop.folder}; record one first.", width)
            return
        self.session = self.session if self.session in sessions else sessions[0]
        menu_style.choice(menu, "Demonstrations", sessions, self.session, self._take_session, width=width)
        menu_style.choice(
            menu, "Policy", list(TRAINABLE_POLICIES), shop.settings.policy, self._take_policy, width=width
        )
        self.model = self.model or self._proposal()
        menu_style.entry(menu, "Model to write", self.model, self._take_model, width=width)
        menu_style.switch(menu, "Replace it if it exists", self.replace_model, self._take_replace)
        menu_style.button(menu, "Train", self.start, main=True)
        menu_style.button(menu, "Cancel", self.cancel)

    def _proposal(self) -> str:
        return f"{self.session.removesuffix('.h5')}-{self.shop.settings.policy}.npz"

    def _take_session(self, name: str) -> None:
        self._renamed(lambda: setattr(self, "session", name))

    def _take_policy(self, name: str) -> None:
        self._renamed(lambda: self.shop.change(replace(self.shop.settings, policy=name)))

    def _renamed(self, change: Any) -> None:
        """A model's name that was only proposed follows what it was proposed from."""
        follows = self.model == self._proposal()
        change()
        if follows and self.model != self._proposal():
            self.model = self._proposal()
            self._rebuild = True

    _rebuild: bool = False

    def _take_model(self, name: str) -> None:
        self.model = name.strip()

    def _take_replace(self, on: bool) -> None:
        self.replace_model = on

    def start(self) -> None:
        folder = self.shop.folder
        model = self.model if self.model.endswith(".npz") else f"{self.model}.npz"
        arguments = ["train", str(folder / self.session), str(folder / model), "--policy", self.shop.settings.policy]
        self._noted = False
        self.run([*arguments, *(["--force"] if self.replace_model else [])])

    def update(self) -> None:
        if self._rebuild and self.menu is not None:
            self._rebuild = False
            self.build()
        if self.job is not None and self.job.status == 0 and not self._noted:
            # What was just learned is what one wants to see place.
            self._noted = True
            self.shop.change(replace(self.shop.settings, model=self.model))
