"""Real key and mouse events of an X server: pauses between keys, taps of 5 ms, and screens of several sizes."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from layflat.app.workstation.window import style
from layflat.app.workstation.window.painter import FITS
from layflat.data.session.reader import open_session
from layflat.tests.app.workstation.x_display import Display, Recorder, eventually, x_display

pytestmark = pytest.mark.timeout(300)
SCREENS = {"800x600": 96, "1280x720": 96, "3840x2160": 192}
OPTIONS = ("--source", "keyboard", "--robot", "pickers", "--episodes", "1")


@pytest.fixture
def recorders() -> Iterator[list[Recorder]]:
    made: list[Recorder] = []
    yield made
    for recorder in made:
        recorder.kill()


def taps(path: Path) -> list[int]:
    """Return the number of steps in each run of steps in which the left picker went down."""
    with open_session(path) as session:
        down = np.array([step.action[5] < 0 for step in session[0].steps])
    edges = np.flatnonzero(np.diff([False, *down.tolist(), False]))
    return (edges[1::2] - edges[::2]).tolist()


def tap(display: Display, key: str, seconds: float) -> None:
    """Press and release a key in one call, so that nothing but ``seconds`` lies between."""
    display.xdotool("keydown", key, "sleep", seconds, "keyup", key)


LONG = pytest.param((0.5, 1.0, 2.0), marks=pytest.mark.slow)


@pytest.mark.parametrize("pauses", [(0.8,), LONG], ids=str)
def test_each_tap_moves_for_a_step_whatever_the_pause(tmp_path, recorders, pauses):
    with x_display() as display:
        recorder = Recorder(display, tmp_path, *OPTIONS)
        recorders.append(recorder)
        recorder.go("still")
        for pause_s in (*pauses, 1.5):
            tap(display, "s", 0.005)
            time.sleep(pause_s)
        display.key("n")
        status, lines, errors = recorder.ended()
    assert status == 0, errors
    assert lines[0].startswith("kept demo_0 failure ")
    runs = taps(recorder.path)
    assert len(runs) == len(pauses) + 1
    assert max(runs) <= 4, "a tap is short"


def test_keys_without_a_pause_and_a_tap_while_another_is_held_all_act(tmp_path, recorders):
    with x_display() as display:
        recorder = Recorder(display, tmp_path, *OPTIONS)
        recorders.append(recorder)
        recorder.go("still")
        display.xdotool("keydown", "k", "sleep", "1.0")  # The right picker goes down.
        display.xdotool("keydown", "d", "keyup", "d")  # The left one moves forward.
        display.xdotool("sleep", "1.0", "keyup", "k", "keydown", "w", "keyup", "w", "keydown", "9", "keyup", "9")
        time.sleep(1.0)
        display.key("n")
        status, _, errors = recorder.ended()
    assert status == 0, errors
    with open_session(recorder.path) as session:
        actions = np.array([step.action for step in session[0].steps]).reshape(-1, 2, 3)
    assert (actions[:, 0, 2] < 0).sum() >= 5
    assert 1 <= (actions[:, 1, 0] > 0).sum() <= 4
    assert 1 <= (actions[:, 1, 2] > 0).sum() <= 4


def fitting_scale_of(width: int, height: int) -> tuple[float, float]:
    return width / FITS[0], height / FITS[1]


@pytest.mark.parametrize("size", [pytest.param("1280x720", marks=pytest.mark.slow), "800x600", "3840x2160"])
def test_the_window_fits_the_screen_and_its_letters_the_dots(tmp_path, recorders, size):
    """The whole window is on the screen, with its title bar, and letters are as large as 13 px at 96 dpi."""
    wide = int(size.split("x")[0])
    with x_display(size, SCREENS[size], managed=True) as display:
        recorder = Recorder(display, tmp_path, *OPTIONS)
        recorders.append(recorder)
        recorder.go("waiting")
        time.sleep(1.0)
        words = display.xdotool("getwindowgeometry", "--shell", display.window()).split()
        place = dict(word.split("=") for word in words if "=" in word)
        seen = display.picture()
        display.xdotool("windowsize", display.window(), 700, 500, "sleep", "0.5")
        display.key("Escape")
        status, _, errors = recorder.ended()
    assert status == 0, errors
    width, height = int(place["WIDTH"]), int(place["HEIGHT"])
    assert width >= 0.6 * wide
    # All of it is on the screen: its ground is seen up to each of its edges.
    rows, columns = np.nonzero((seen == style.BACKGROUND).all(axis=-1))
    assert (np.ptp(columns) + 1, np.ptp(rows) + 1) == (width, height)
    scale = min(SCREENS[size] / 96, *fitting_scale_of(width, height))
    column = columns.min() + round(24 * scale)
    boxes = (seen[rows.max() - round(0.3 * height) : rows.max(), column] == style.RAISED).all(axis=-1)
    assert boxes.sum() >= 14 * scale, "a key chip of the strip"
    memory = json.loads((tmp_path / "config" / "layflat" / "window.json").read_text())
    assert (memory["width"], memory["height"]) == (700, 500)


def test_a_drag_of_the_mouse_moves_the_robot(tmp_path, recorders):
    with x_display() as display:
        recorder = Recorder(display, tmp_path, *(OPTIONS[0], "mouse", *OPTIONS[2:]))
        recorders.append(recorder)
        recorder.go("still")
        size = sum(one.stat().st_size for one in recorder.journals())
        display.xdotool("mousemove", 400, 300, "mousedown", 1, "sleep", "0.1", "mousemove", 400, 420)
        eventually(lambda: sum(one.stat().st_size for one in recorder.journals()) > size + 2000, "some steps")
        display.xdotool("sleep", "0.5", "mouseup", 1)
        display.key("n")
        status, lines, errors = recorder.ended()
    assert status == 0, errors
    assert lines[0].startswith("kept demo_0 failure ")
    assert len(taps(recorder.path)) == 1
