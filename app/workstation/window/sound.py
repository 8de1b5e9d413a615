"""A soft tone when the cloth begins to touch the table, generated here; silent where there is no sound card."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pygame

from layflat.app.workstation.teleop.contact_rumble import ContactBegin

RATE_HZ, TONE_HZ, TONE_S, LOUDNESS = 22_050, 660.0, 0.18, 0.25


class ContactTone(ContactBegin):
    """Plays a tone each time contact begins, if ``on``."""

    def __init__(self) -> None:
        super().__init__()
        self.on = True
        self._sound: pygame.mixer.Sound | None = None
        self._tried = False

    def begin(self) -> None:
        """Play the tone, if it is on."""
        if self.on:
            self.play()

    def play(self) -> None:
        """Play the tone; the sound card is opened by the first one."""
        if not self._tried:
            self._tried = True
            with suppress(pygame.error):
                pygame.mixer.init(RATE_HZ, -16, 1, 512)
                self._sound = pygame.mixer.Sound(buffer=tone().tobytes())
        if self._sound is not None:
            self._sound.play()

    def close(self) -> None:
        """Close the sound card."""
        self._sound = None
        with suppress(pygame.error):
            pygame.mixer.quit()


def tone() -> np.ndarray:
    """Return the samples, 16 bits: a sine that swells and fades, since a sudden start would click."""
    time_s = np.arange(int(RATE_HZ * TONE_S)) / RATE_HZ
    swell = np.sin(np.pi * time_s / TONE_S) ** 2
    return np.asarray(32767 * LOUDNESS * swell * np.sin(2 * np.pi * TONE_HZ * time_s), dtype=np.int16)
