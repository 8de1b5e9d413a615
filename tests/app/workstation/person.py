"""A person at the workstation: looks at the window, moves a pad that SDL takes for real, presses buttons and keys."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pygame
import pygame_menu
from pygame_menu.widgets import Button, DropSelect, TextInput

from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.gamepad_state import DEAD_ZONE
from layflat.app.workstation.window.window import FRAMES_HZ, Window
from layflat.data.types import ACTION_LIMIT_M, GroundTruth, Observation
from layflat.policy.scripted.demonstrator import ScriptedDemonstrator
from layflat.sim.cloth.spec import HELD_STRETCH, cloth_spec
from layflat.sim.disturbances.mouse_drag import pick_node
from layflat.sim.robots.registry import robot_spec
from layflat.tests.virtual_pad import VirtualPad

PATIENCE_S = 90.0
"""For a machine that does ten other things."""


class Person:
    """Sits before a window."""

    def __init__(self, window: Window, pad: VirtualPad | None = None) -> None:
        self.window = window
        self.pad = pad
        self.frames = 0
        self._expert: ScriptedDemonstrator | None = None
        self._seen = (0, -1)
        self._clock = pygame.time.Clock()

    @property
    def status(self) -> dict:
        return self.window.shop.link.status

    def state(self) -> str:
        return str(self.status.get("state", ""))

    def moment(self) -> BenchFrame | None:
        return self.window.mode.moment()

    def look(self) -> None:
        """One frame."""
        self.window.frame()
        self.frames += 1
        self._clock.step(FRAMES_HZ)

    def wait(self, until: Callable[[], bool], what: str, seconds: float = PATIENCE_S) -> None:
        """Watch until it is so."""
        give_up = time.monotonic() + seconds
        while not until():
            if time.monotonic() > give_up:
                shop = self.window.shop
                raise AssertionError(
                    f"waited {seconds:.0f} s for {what}: {shop.message!r} {shop.link.sentence!r} {self.status}"
                )
            self.look()

    def watch(self, seconds: float) -> None:
        give_up = time.monotonic() + seconds
        while time.monotonic() < give_up:
            self.look()

    # Mouse and keys

    def tab(self, name: str) -> None:
        self.look()
        area = next(area for area, mode in self.window.tabs if mode.name == name)
        self.click(area.center)
        assert self.window.mode.name == name, self.window.shop.message

    def click(self, at: tuple[int, int]) -> None:
        post(pygame.MOUSEMOTION, pos=at, rel=(0, 0), buttons=(0, 0, 0))
        post(pygame.MOUSEBUTTONDOWN, pos=at, button=1)
        post(pygame.MOUSEBUTTONUP, pos=at, button=1)
        self.look()

    def key(self, code: int, text: str = "") -> None:
        # pygame-menu asks the keyboard itself whether a key is down, but for tests.
        post(pygame.KEYDOWN, key=code, mod=0, unicode=text, test=True)
        post(pygame.KEYUP, key=code, mod=0)
        self.look()

    def press(self, text: str) -> None:
        """Click on what the strip says, by what it does or by its key."""
        self.window.draw()
        for (area, _), chip in zip(self.window.chips, self.window.mode.chips(), strict=False):
            if text in (chip.key, chip.does):
                self.click(area.center)
                return
        raise AssertionError(f"no button {text!r} among {[chip[:2] for chip in self.window.mode.chips()]}")

    def menu(self, text: str) -> None:
        """Press a button of the menu by what is written on it."""
        menu = self.window.mode.menu
        assert menu is not None
        widget = next(w for w in menu.get_widgets() if isinstance(w, Button) and w.get_title() == text)
        menu.scroll_to_widget(widget)
        area = widget.get_rect(to_real_position=True)
        self.click(area.center)

    def choose(self, number: int, name: str) -> None:
        """Open the ``number``-th list of the menu and click on what it has by that name."""
        menu = self.window.mode.menu
        assert menu is not None
        widget = [w for w in menu.get_widgets() if isinstance(w, DropSelect)][number]
        names = [item[0] for item in widget.get_items()]
        area = widget.get_rect(to_real_position=True)
        self.click(area.center)
        assert widget.active
        # Its first rows are seen without scrolling.
        row = names.index(name)
        box = widget._drop_frame.get_widgets()[row].get_rect(to_real_position=True)
        self.click(box.center)

    def widget(self, kind: type, number: int = 0) -> Any:
        """The ``number``-th widget of a kind in the menu, after a click on it, near its right end."""
        menu = self.window.mode.menu
        assert menu is not None
        found = [w for w in menu.get_widgets() if isinstance(w, kind)][number]
        area = found.get_rect(to_real_position=True)
        self.click((area.right - 16, area.centery))
        return found

    def write(self, number: int, text: str) -> None:
        """Write into the ``number``-th line of the menu, behind what is there."""
        self.widget(TextInput, number)
        for letter in text:
            self.key(ord(letter), letter)

    def drag_node(
        self,
        node: int,
        by: tuple[int, int],
        frames: int = 20,
        *,
        until: Callable[[], bool] = lambda: True,
        shot: Callable[[], None] | None = None,
    ) -> int | None:
        """Take hold of a node with the mouse, or of what hides it, lead it by so many pixels, and let go.

        Returns the node that is seen there.
        """
        moment, view = self.moment(), self.window.shop.place.view
        assert moment is not None
        x, y = self.window.pane.pixel_of(moment.nodes[node], view.size)
        triangles = cloth_spec(moment.cloth).triangles()
        seen = pick_node(moment.nodes, triangles, *self.window.pane.orbit.ray((x, y), view.size))
        self.drag_pixel((x + view.left, y + view.top), by, frames, until=until, shot=shot)
        return seen

    def drag_pixel(
        self,
        at: tuple[int, int],
        by: tuple[int, int],
        frames: int = 20,
        *,
        until: Callable[[], bool] = lambda: True,
        shot: Callable[[], None] | None = None,
    ) -> None:
        """The same of whatever is at a pixel of the window; it is held until then."""
        post(pygame.MOUSEMOTION, pos=at, rel=(0, 0), buttons=(0, 0, 0))
        post(pygame.MOUSEBUTTONDOWN, pos=at, button=1)
        self.look()
        done = np.zeros(2, int)
        for k in range(1, frames + 1):
            now = np.rint(np.array(by) * k / frames).astype(int)
            step, done = now - done, now
            at = (at[0] + int(step[0]), at[1] + int(step[1]))
            post(pygame.MOUSEMOTION, pos=at, rel=(int(step[0]), int(step[1])), buttons=(1, 0, 0))
            self.look()
        self.wait(until, "what is dragged")
        if shot is not None:
            shot()
        post(pygame.MOUSEBUTTONUP, pos=at, button=1)
        self.look()

    # The pad

    def plug_in(self) -> VirtualPad:
        """A pad, in the hands until ``unplug_all``."""
        self.pad = VirtualPad()
        _PLUGGED.append(self.pad)
        return self.pad

    def begin(self, seconds: float = PATIENCE_S) -> None:
        """Start the demonstration that waits, and see it count down."""
        self.wait(lambda: self.state() == "waiting" and bool(self.status.get("ready")), "the cloth to hang", seconds)
        self.pad.tap("cross")
        self.wait(lambda: self.state() == "running", "the countdown")

    def demonstrate(self, seed: int, *, n_steps: int | None = None, seconds: float = 240.0) -> None:
        """Lay the cloth with the sticks, as the scripted demonstrator would from what the window shows."""
        moment = self.moment()
        assert moment is not None
        if self._expert is None or self._seen[0] != moment.episode:
            self._expert = self._teacher(moment)
            self._expert.reset(seed)
            self._seen = (moment.episode, -1)
        self.pad.axis("r2", 1.0)
        self.wait(
            lambda: self._move() or (n_steps is not None and self.status.get("steps", 0) >= n_steps), "the end", seconds
        )
        self.rest()

    def rest(self) -> None:
        for name in ("left_x", "left_y", "right_x", "right_y"):
            self.pad.axis(name, 0.0)
        self.look()

    def _teacher(self, moment: BenchFrame) -> ScriptedDemonstrator:
        spec, robot = cloth_spec(moment.cloth), robot_spec(moment.robot)
        return ScriptedDemonstrator(
            robot, length_m=spec.length_m, columns=spec.columns, held_width_m=HELD_STRETCH * spec.width_m,
            ground_truth=lambda: truth_of(self.moment()),
        )  # fmt: skip

    def _move(self) -> bool:
        """Push the sticks as the newest moment asks for; True once the cloth lies."""
        moment = self.moment()
        if moment is None or (moment.episode, moment.step) == self._seen:
            return self.state() not in ("running", "paused")
        self._seen = (moment.episode, moment.step)
        decision = self._expert.act(seen_of(moment))
        if decision.stop is not None:
            return True
        wanted = decision.action / ACTION_LIMIT_M
        if moment.robot == "hanger":
            self._stick("left", wanted[0], wanted[1])
        else:
            # The window's left is picker 2.
            self._stick("right", wanted[0], wanted[2])
            self._stick("left", wanted[3], wanted[5])
        return False

    def _stick(self, side: str, right: float, up: float) -> None:
        """Against the dead zone: what is wanted behind it."""
        length = min(math.hypot(right, up), 1.0)
        scale = (DEAD_ZONE + (1 - DEAD_ZONE) * length) / math.hypot(right, up) if length > 1e-6 else 0.0
        self.pad.axis(f"{side}_x", right * scale)
        self.pad.axis(f"{side}_y", -up * scale)


_PLUGGED: list[VirtualPad] = []


def unplug_all() -> None:
    """Every pad that anybody has plugged in; an SDL that ends under one crashes."""
    while _PLUGGED:
        _PLUGGED.pop().unplug()


def post(kind: int, **values: object) -> None:
    pygame.event.post(pygame.event.Event(kind, values))


def truth_of(moment: BenchFrame) -> GroundTruth:
    return GroundTruth(nodes=moment.nodes, contact_portion_true=moment.contact_true, flat_area=moment.flat_area)


def seen_of(moment: BenchFrame) -> Observation:
    return Observation(
        time_s=moment.sim_s,
        corner_positions=moment.corners,
        holder_position=moment.holder,
        word=moment.word,
        word_strength=moment.strength,
        contact_portion=moment.contact,
    )


def headless() -> None:
    """SDL without a display and without sound."""
    sdl.prepare()
    os.environ["SDL_VIDEODRIVER"] = "dummy"
    os.environ["SDL_AUDIODRIVER"] = "dummy"
    # It has no cursors either, of which pygame-menu would print a stack each time.
    pygame_menu.utils.warn = lambda *_: None
