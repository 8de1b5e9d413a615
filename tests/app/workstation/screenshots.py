"""`make screenshots`: pictures of the live window for the documentation, taken while a person uses it.

python -m layflat.tests.app.workstation.screenshots docs/images

The pictures are SDL's own, so no display is needed.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
import pygame
from PIL import Image

from layflat.app.workers.sim_options import sim_config
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.window import display
from layflat.app.workstation.window.display import WindowMemory
from layflat.app.workstation.window.window import Window
from layflat.policy.spec import PolicySpec
from layflat.tests.app.workstation.person import Person, headless, unplug_all

COLORS = 224
"""Colours of a picture's palette: a quarter of the bytes, without a visible difference."""


def shoot(window: Window, path: Path) -> None:
    """Write what the window shows."""
    window.painter.forget()
    window.painter.draw()
    rgb = np.ascontiguousarray(pygame.surfarray.array3d(window.painter.surface).swapaxes(0, 1))
    Image.fromarray(rgb).quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path} {path.stat().st_size // 1000} kB", flush=True)


def open_window(folder: Path, robot: str, source: str, size: tuple[int, int], **options: object) -> Person:
    """Open a window of some size that records as fast as possible."""
    display.save_memory(WindowMemory(width=size[0], height=size[1]))
    request = SessionRequest(
        sim_config=sim_config(robot=robot, cloth="towel"), source=source, session=folder / f"{robot}-{source}.h5",
        episodes=20, seed=0, speed=0.0, countdown_s=0.3, **options,  # type: ignore[arg-type]
    )  # fmt: skip
    return Person(Window(request, on_event=print))


def by_gamepad(folder: Path, out: Path) -> None:
    """A demonstration in its middle, and the question after a folded one."""
    person = open_window(folder, "hanger", "gamepad", (1280, 720))
    person.plug_in()
    person.begin()
    person.demonstrate(0, n_steps=40)
    shoot(person.window, out / "workstation-record-hanger.png")
    person.pad.tap("triangle")
    person.wait(lambda: person.state == "asking", "the question")
    person.look()
    shoot(person.window, out / "workstation-question.png")
    person.window.close()
    unplug_all()


def by_hand(folder: Path, out: Path) -> None:
    """The hanger is guided by the mouse."""
    person = open_window(folder, "hanger", "kinesthetic", (1280, 720))
    person.wait(lambda: person.state == "waiting" and person.status.ready, "the cloth")
    person.key(pygame.K_RETURN)
    person.wait(lambda: person.state == "still", "the countdown")
    frame, view = person.seen(), person.window.painter.layout.view
    x, y = person.window.inputs.viewport.pixel_of(frame.corners[1], view.size)
    person.drag_pixel(
        (x + view.left, y + view.top), (50, 120), frames=60,
        until=lambda: person.status.steps >= 16 and shoot(person.window, out / "workstation-kinesthetic.png") is None,
    )  # fmt: skip
    person.window.close()


def disturbed(folder: Path, out: Path) -> None:
    """A hand pushes a placed cloth, which a policy will repair."""
    person = open_window(folder, "hanger", "mouse", (1280, 720), policy=PolicySpec(builtin="scripted"))
    person.wait(lambda: person.state == "waiting" and person.status.ready, "the cloth")
    person.key(pygame.K_RETURN)
    person.wait(lambda: person.state == "stopped", "the placing", 240)
    person.key(pygame.K_b)
    person.wait(lambda: len(person.seen().hands) > 0 and np.linalg.norm(person.seen().force_n) > 0.3, "the push")
    shoot(person.window, out / "workstation-place-disturbed.png")
    person.window.close()


def small(folder: Path, out: Path) -> None:
    """The window on a screen of 800 x 600."""
    person = open_window(folder, "pickers", "keyboard", (800, 560))
    person.wait(lambda: person.state == "waiting" and person.status.ready, "the cloth")
    person.look()
    shoot(person.window, out / "workstation-small.png")
    person.window.close()


if __name__ == "__main__":
    headless()
    os.environ["LAYFLAT_OPERATOR"] = "operator"
    with tempfile.TemporaryDirectory() as name:
        os.environ["XDG_CONFIG_HOME"] = name
        for part in (by_gamepad, by_hand, disturbed, small):
            part(Path(name), Path(sys.argv[1]))
