"""`make screenshots`: the pictures of docs/how-to/workstation.md, taken of the real window while a person uses it.

    python -m layflat.tests.app.workstation.screenshots docs/images runs/screenshots

The pictures are SDL's own, so no display is needed. The second folder keeps what is recorded.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pygame
from PIL import Image

from layflat.app.workstation.session.activities import make_activity
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.window import style
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.pages.record import RecordPage
from layflat.app.workstation.window.pages.replay import ReplayPage
from layflat.app.workstation.window.window import Window
from layflat.tests.app.workstation.person import Person, headless, unplug_all

COLORS = 224
"""Colors of a picture's palette: a quarter of the bytes, without a visible difference."""


class Album:
    """Takes the pictures."""

    def __init__(self, window: Window, out: Path) -> None:
        self.window = window
        self.person = Person(window)
        self.out = out

    def shoot(self, name: str) -> None:
        """Write ``workstation-<name>.png``."""
        self.window.redraw()
        rgb = np.ascontiguousarray(pygame.surfarray.array3d(self.window.surface).swapaxes(0, 1))
        path = self.out / f"workstation-{name}.png"
        palette = Image.fromarray(np.vstack([rgb, swatches(rgb.shape[1])]))
        palette = palette.quantize(COLORS, method=Image.Quantize.MEDIANCUT)
        Image.fromarray(rgb).quantize(palette=palette, dither=Image.Dither.NONE).save(path, optimize=True)
        print(f"{path} {path.stat().st_size // 1000} kB", flush=True)

    def settings(self, **changes: object) -> None:
        context = self.window.context
        context.change_settings(replace(context.settings, **changes))  # type: ignore[arg-type]
        self.window.page.on_resize()

    def wait_for_state(self, state: str) -> None:
        self.person.wait(lambda: self.person.state() == state, state, 60.0)


def swatches(width: int) -> np.ndarray:
    """Return the window's own colors, (H, W, 3), so that a palette has them all."""
    own = [value for value in vars(style).values() if isinstance(value, tuple) and len(value) == 3]
    return np.repeat(np.repeat(np.array(own, np.uint8)[:, None], 16, axis=0), width, axis=1)


def demonstrations(folder: Path) -> None:
    """Record sessions to train from, where they do not exist yet."""
    for robot in ("hanger", "pickers"):
        path = folder / f"{robot}.h5"
        if not path.exists():
            job = SubprocessCommand(["record", str(path), "--robot", robot, "--episodes", "6", "--workers", "1"])
            while job.status is None:
                pygame.time.wait(200)
            print(*job.lines, sep="\n")


def record(album: Album) -> None:
    person, window = album.person, album.window
    album.settings(session="demonstrations.h5", speed="as fast as possible", countdown_s=2.0, robot="hanger")
    album.shoot("record-menu")
    person.plug_in()
    for robot in ("hanger", "pickers"):
        album.settings(robot=robot, session=f"by-hand-{robot}.h5")
        person.menu("Start")
        person.wait(lambda: person.state() == "waiting" and bool(person.status.get("ready")), "the cloth")
        if robot == "hanger":
            person.pad.tap("cross")
            album.wait_for_state("countdown")
            person.watch(0.4)
            album.shoot("record-countdown")
            album.wait_for_state("running")
        else:
            person.begin()
        person.demonstrate(0, n_steps=34)
        album.shoot(f"record-{robot}")
        if robot == "hanger":
            person.pad.unplug()
            album.wait_for_state("paused")
            album.shoot("record-unplugged")
            person.plug_in()
            album.wait_for_state("running")
        person.demonstrate(0)
        person.pad.tap("triangle")
        person.wait(lambda: person.status.get("n_episodes", 0) > 0 and person.state() == "waiting", "it to be kept")
        assert isinstance(window.page, RecordPage)
        window.page.stop()
    person.pad.unplug()


def guide_by_hand(album: Album) -> None:
    person, window = album.person, album.window
    person.tab("Record")
    album.settings(source="kinesthetic", robot="hanger", session="led.h5", speed="real time", countdown_s=0.0)
    person.menu("Start")
    person.wait(lambda: person.state() == "waiting" and bool(person.status.get("ready")), "the cloth")
    person.key(pygame.K_RETURN)
    album.wait_for_state("running")
    frame, view = person.seen(), window.context.layout.view
    x, y = window.viewport.pixel_of(frame.corners[1], view.size)
    person.drag_pixel(
        (x + view.left, y + view.top),
        (70, 170),
        frames=60,
        until=lambda: person.status["steps"] >= 16,
        shot=lambda: album.shoot("kinesthetic"),
    )
    window.page.stop()
    album.settings(source="gamepad")


def train(album: Album) -> None:
    person, window = album.person, album.window
    person.tab("Train")
    for session in ("pickers", "hanger"):
        page = window.page
        page.session, page.model = f"{session}.h5", f"{session}-gp-word.npz"
        page.overwrite = True
        page.build()
        person.menu("Train")
        person.wait(lambda page=page: page.command is not None and page.command.status is not None, "training", 180.0)
        person.watch(0.3)
    album.shoot("train")


def place(album: Album) -> None:
    person, window = album.person, album.window
    album.settings(model="hanger-gp-word.npz", speed="real time")
    person.tab("Place")
    assert isinstance(window.page, PlacePage)
    window.page.seed, window.page.record = 21, "placed.h5"
    window.page.build()
    person.menu("Place")
    person.wait(lambda: person.status.get("steps", 0) >= 42, "42 steps", 60.0)
    album.shoot("place")
    album.wait_for_state("placed")
    person.key(pygame.K_1)
    album.wait_for_state("disturbing")
    person.wait(lambda: np.linalg.norm(window.page.frame().force_n) > 0.3, "the push")
    person.watch(0.4)
    album.shoot("place-disturbed")
    album.wait_for_state("repairing")
    album.wait_for_state("placed")
    person.key(pygame.K_k)
    person.wait(lambda: window.page.finished, "it to be kept")


def take_over(album: Album) -> None:
    """A person takes over twice while a model places."""
    person, window = album.person, album.window
    album.settings(model="hanger-gp-word.npz", speed="real time")
    person.plug_in()
    person.tab("Place")
    assert isinstance(window.page, PlacePage)
    window.page.seed, window.page.record, window.page.source = 21, "placed-corrected.h5", "gamepad"
    window.page.build()
    person.menu("Place")
    for n_steps, human in ((22, 5), (42, 16)):
        person.wait(lambda n_steps=n_steps: person.status.get("steps", 0) >= n_steps, f"{n_steps} steps", 60.0)
        person.pad.axis("left_x", 0.5)
        person.wait(
            lambda human=human: person.status["intervention_steps"] >= human, f"{human} steps of the person", 60.0
        )
        if human == 5:
            person.rest()
            person.wait(lambda: person.status["controller"] == "gp-word", "the model", 60.0)
    album.shoot("take-over")
    person.rest()
    window.page.stop()
    window.page.source = "none"
    person.pad.unplug()


def disturb(album: Album) -> None:
    person, window = album.person, album.window
    album.settings(model="pickers-gp-word.npz")
    person.tab("Disturb")
    assert isinstance(window.page, PlacePage)
    window.page.seed = 5
    window.page.build()
    person.menu("Place and disturb")
    album.wait_for_state("placed")
    person.drag_node(
        45, (-90, -120), frames=40, until=lambda: person.status["drag_steps"] >= 9, shot=lambda: album.shoot("disturb")
    )
    album.wait_for_state("repairing")
    window.page.stop()


def look_back(album: Album) -> None:
    person, window = album.person, album.window
    person.tab("Replay")
    page = window.page
    assert isinstance(page, ReplayPage)
    page.session = "placed.h5"
    page.build()
    person.menu("Watch")
    n_steps = [k for k, step in enumerate(page.playback.episode.steps) if step.phase == "disturb"]
    page.show(n_steps[min(5, len(n_steps) - 1)])
    album.shoot("replay")
    person.tab("Data")
    window.page.session = "hanger.h5"
    window.page.build()
    person.menu("Info")
    person.wait(lambda: window.page.command.status is not None, "info")
    person.watch(0.3)
    album.shoot("data")
    person.tab("Settings")
    album.shoot("settings")


def small(album: Album) -> None:
    """The smallest size that is laid out."""
    person, window = album.person, album.window
    pygame.display.set_mode((960, 600), pygame.RESIZABLE)
    window._resize()
    album.settings(model="hanger-gp-word.npz")
    person.tab("Place")
    window.page.seed = 21
    window.page.build()
    person.menu("Place")
    person.wait(lambda: person.status.get("steps", 0) >= 45, "45 steps", 60.0)
    album.shoot("small")


PARTS = {
    "record": record,
    "guide": guide_by_hand,
    "train": train,
    "place": place,
    "take-over": take_over,
    "disturb": disturb,
    "look-back": look_back,
    "small": small,
}


def main(out: Path, folder: Path, parts: list[str]) -> None:
    headless()
    os.environ["LAYFLAT_OPERATOR"] = "operator"
    folder.mkdir(parents=True, exist_ok=True)
    for old in [*folder.glob("by-hand*"), *folder.glob("placed*")] if not parts else []:
        old.unlink() if old.is_file() else old.rmdir()
    demonstrations(folder)
    window = Window(folder, make_activity)
    try:
        for name, part in PARTS.items():
            if not parts or name in parts:
                part(Album(window, out))
    finally:
        unplug_all()
        window.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
