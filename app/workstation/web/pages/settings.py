"""Settings: parts and speed of the simulation, kept in the folder."""

from __future__ import annotations

from layflat.app.workstation.settings import FILE, SPEEDS
from layflat.app.workstation.web.viewer import Page
from layflat.perception.descriptors.registry import DESCRIPTORS


class SettingsPage(Page):
    """Settings of the workstation."""

    name = "Settings"

    def build(self) -> None:
        now, gui = self.workstation.settings, self.gui
        hint = "Simulated over wall time, at most, of the next take."
        self.setting("speed", self.choice("Speed", list(SPEEDS), now.speed, hint=hint))
        hint = "How the direction of the wrinkles is found: word-axial and word by the thesis, how and hog to compare."
        self.setting("descriptor", self.choice("Descriptor", list(DESCRIPTORS), now.descriptor, hint=hint))
        self.setting("noise", gui.add_checkbox("Depth noise", now.noise, hint="Noise of the simulated camera."))
        self.setting("images", gui.add_checkbox("Save images", now.images, hint="About 16 MB an episode."))
        hint = "Before each demonstration."
        countdown = gui.add_slider("Countdown (s)", 0.0, 10.0, 0.5, now.countdown_s, hint=hint)
        self.setting("countdown_s", countdown)
        self.setting("dark", gui.add_checkbox("Dark pages", now.dark, hint="For all who watch."))
        kept = "this folder can only be looked at, so they last until the server ends"
        self.note(kept if self.folder.read_only else f"kept in {FILE} of {self.folder.path}")
