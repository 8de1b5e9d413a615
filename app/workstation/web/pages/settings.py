"""Settings: parts and speed of the simulation, kept in the folder."""

from __future__ import annotations

from layflat.app.workstation.settings import FILE, SPEEDS
from layflat.app.workstation.web.pages.page import Page
from layflat.perception.descriptors.registry import DESCRIPTORS


class SettingsPage(Page):
    """Settings of the workstation."""

    name = "Settings"

    def build(self) -> None:
        """Add the page's parts."""
        now = self.workstation.settings
        self.choice(
            "Speed",
            list(SPEEDS),
            now.speed,
            self.setting("speed"),
            "Simulated over wall time, at most, of the next take.",
        )
        self.choice(
            "Descriptor", list(DESCRIPTORS), now.descriptor, self.setting("descriptor"),
            "How the direction of the wrinkles is found: word-axial and word by the thesis, how and hog to compare.",
        )  # fmt: skip
        noise = self.gui.add_checkbox("Depth noise", now.noise, hint="Noise of the simulated camera.")
        self.viewer.on_change(noise, lambda: self.setting("noise")(bool(noise.value)))
        images = self.gui.add_checkbox("Save images", now.images, hint="About 16 MB an episode.")
        self.viewer.on_change(images, lambda: self.setting("images")(bool(images.value)))
        countdown = self.gui.add_slider(
            "Countdown (s)", 0.0, 10.0, 0.5, now.countdown_s, hint="Before each demonstration."
        )
        self.viewer.on_change(countdown, lambda: self.setting("countdown_s")(float(countdown.value)))
        kept = "this folder can only be looked at, so they last until the server ends"
        self.note(kept if self.folder.read_only else f"kept in {FILE} of {self.folder.path}")
