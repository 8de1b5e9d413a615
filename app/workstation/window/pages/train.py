"""TrainPage: train a model from demonstrations, in the background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from layflat.app.workstation.window.pages.command import CommandPage
from layflat.policy.registry import TRAINABLE_POLICIES


@dataclass
class TrainPage(CommandPage):
    """Page of `layflat train`."""

    name: str = "Train"
    model: str = ""
    overwrite: bool = False
    intro = (
        "Trains a policy on the successful demonstrations of a session and writes it as a model.",
        "gp-word sees the cloth: how much of it lies on the table, and in which direction its wrinkles contract. "
        "gp-baseline sees only where the robot is.",
        "A few demonstrations are enough; training takes seconds to a minute. You may go to another tab meanwhile.",
    )
    _noted: bool = False
    """Whether the model of the last command was chosen for placing."""

    def build(self) -> None:
        """Make the menu."""
        form = self.session_form("Train", "Demonstrations")
        if form is None:
            return
        policy = self.context.settings.policy
        form.choice("Policy", list(TRAINABLE_POLICIES), policy, lambda p: self._rename_after(self._choose_policy, p))
        self.model = self.model or self._proposed_name()
        form.entry("Model to write", self.model, self._set_model)
        form.switch("Overwrite it if it exists", self.overwrite, self._set_overwrite)
        form.button("Train", self.start, main=True)
        form.button("Cancel", self.cancel)

    def _proposed_name(self) -> str:
        return f"{self.session.removesuffix('.h5')}-{self.context.settings.policy}.npz"

    def choose_session(self, name: str) -> None:
        """Take another session."""
        self._rename_after(super().choose_session, name)

    def _choose_policy(self, name: str) -> None:
        self.setting("policy")(name)

    def _rename_after(self, change: Callable[[str], None], value: str) -> None:
        """Propose another name for the model after a change, unless the person has written one."""
        proposed = self.model == self._proposed_name()
        change(value)
        if proposed and self.model != self._proposed_name():
            self.model, self.rebuild = self._proposed_name(), True

    def _set_model(self, name: str) -> None:
        self.model = name

    def _set_overwrite(self, on: bool) -> None:
        self.overwrite = on

    def start(self) -> None:
        """Start the training."""
        folder = self.context.folder
        model = self.model if self.model.endswith(".npz") else f"{self.model}.npz"
        arguments = ["train", str(folder / self.session), str(folder / model)]
        self._noted = False
        self.run([*arguments, "--policy", self.context.settings.policy, *(["--force"] if self.overwrite else [])])

    def update(self) -> None:
        """Choose a model that was just trained for placing."""
        super().update()
        if self.command is not None and self.command.status == 0 and not self._noted:
            self._noted = True
            self.setting("model")(self.model)
