"""A person at the window, who moves a virtual gamepad and presses buttons and keys."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable

import numpy as np
import pygame

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.status import SessionEvent, SessionStatus
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.gamepad_state import DEAD_ZONE
from layflat.app.workstation.window.window import FRAMES_HZ, Window
from layflat.data.types import ACTION_LIMIT_M, GroundTruth, Observation
from layflat.policy.scripted.demonstrator import ScriptedDemonstrator
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.cloth.spec import HELD_STRETCH
from layflat.sim.robots.registry import robot_spec
from layflat.tests.virtual_pad import VirtualPad

PATIENCE_S = 90.0
"""Time for a machine that does ten other things."""


class Person:
    """Looks at a window, and acts in it."""

    def __init__(self, window: Window, pad: VirtualPad | None = None, events: list[SessionEvent] | None = None) -> None:
        self.window = window
        self.pad = pad
        self.events = [] if events is None else events
        """What the window has passed on."""
        self._expert: ScriptedDemonstrator | None = None
        self._acted = (0, -1)
        self._clock = pygame.time.Clock()

    @property
    def status(self) -> SessionStatus:
        return self.window.client.status

    @property
    def state(self) -> str:
        return self.status.state

    def seen(self) -> SimulationFrame | None:
        return self.window.client.frame

    def look(self) -> None:
        """Run one frame."""
        self.window.frame()
        self._clock.tick(FRAMES_HZ)

    def wait(self, until: Callable[[], bool], what: str, seconds: float = PATIENCE_S) -> None:
        """Watch until it is so."""
        give_up = time.monotonic() + seconds
        while not until():
            if time.monotonic() > give_up:
                raise AssertionError(f"waited {seconds:.0f} s for {what}: {self.window.client.problem!r} {self.status}")
            self.look()

    def watch(self, seconds: float) -> None:
        give_up = time.monotonic() + seconds
        while time.monotonic() < give_up:
            self.look()

    def keep_anyway(self, until: Callable[[], bool]) -> None:
        """Wait until a take is kept, and answer the question whether the label is meant."""

        def kept() -> bool:
            if self.state == "asking":
                self.window.client.answer(True)
            return until()

        self.wait(kept, "it to be kept")

    # Mouse and keys

    def click(self, at: tuple[int, int]) -> None:
        post(pygame.MOUSEBUTTONDOWN, pos=at, button=1)
        post(pygame.MOUSEBUTTONUP, pos=at, button=1)
        self.look()

    def key(self, code: int, mod: int = 0) -> None:
        """Press and release a key within a frame."""
        post(pygame.KEYDOWN, key=code, mod=mod, unicode="")
        post(pygame.KEYUP, key=code, mod=mod)
        self.look()

    def hold(self, code: int) -> None:
        post(pygame.KEYDOWN, key=code, mod=0, unicode="")
        self.look()

    def release(self, code: int) -> None:
        post(pygame.KEYUP, key=code, mod=0)
        self.look()

    def press(self, text: str) -> None:
        """Click on a key chip, by its text or by its key."""
        self.look()
        for area, hint in self.window.painter.hints:
            if text in (hint.key, hint.text):
                self.click(area.center)
                return
        raise AssertionError(f"no button {text!r} among {[hint[:2] for _, hint in self.window.painter.hints]}")

    def drag_pixel(
        self,
        at: tuple[int, int],
        by: tuple[int, int],
        frames: int = 20,
        *,
        until: Callable[[], bool] = lambda: True,
    ) -> None:
        """Drag what is at a pixel of the window, and release it when ``until`` is true."""
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
        post(pygame.MOUSEBUTTONUP, pos=at, button=1)
        self.look()

    # The pad

    def plug_in(self) -> VirtualPad:
        """Plug in a gamepad, until ``unplug_all``."""
        self.pad = VirtualPad()
        _PLUGGED.append(self.pad)
        return self.pad

    def begin(self, seconds: float = PATIENCE_S) -> None:
        """Start the demonstration that waits, through its countdown."""
        self.wait(lambda: self.state == "waiting" and self.status.ready, "the cloth to hang", seconds)
        self.pad.tap("cross")
        self.wait(lambda: self.state in ("still", "running"), "the countdown")

    def demonstrate(self, seed: int, *, n_steps: int | None = None, seconds: float = 240.0) -> None:
        """Lay the cloth with the sticks, as the scripted demonstrator would by what the window shows."""
        frame = self.seen()
        assert frame is not None
        if self._expert is None or self._acted[0] != frame.episode:
            self._expert = self._demonstrator(frame)
            self._expert.reset(seed)
            self._acted = (frame.episode, -1)
        self.pad.axis("r2", 1.0)
        self.wait(lambda: self._move() or (n_steps is not None and self.status.steps >= n_steps), "the end", seconds)
        self.rest()

    def rest(self) -> None:
        for name in ("left_x", "left_y", "right_x", "right_y"):
            self.pad.axis(name, 0.0)
        self.look()

    def _demonstrator(self, frame: SimulationFrame) -> ScriptedDemonstrator:
        spec, robot = cloth_spec(frame.cloth), robot_spec(frame.robot)
        return ScriptedDemonstrator(
            robot, length_m=spec.length_m, columns=spec.columns, held_width_m=HELD_STRETCH * spec.width_m,
            ground_truth=lambda: truth_of(self.seen()),
        )  # fmt: skip

    def _move(self) -> bool:
        """Push the sticks as the newest frame asks for; return True once the cloth lies."""
        frame = self.seen()
        if frame is None or (frame.episode, frame.step) == self._acted:
            return self.state not in ("still", "running", "paused")
        self._acted = (frame.episode, frame.step)
        decision = self._expert.act(observation_of(frame))
        if decision.stop is not None:
            return True
        wanted = robot_spec(frame.robot).unpack(decision.action / ACTION_LIMIT_M)
        # Of two points, the window's left one is the second.
        for side, (right, _, up) in zip(("right", "left")[-len(wanted) :], wanted, strict=True):
            self._stick(side, right, up)
        return False

    def _stick(self, side: str, right: float, up: float) -> None:
        """Push a stick, beyond its dead zone."""
        length = min(math.hypot(right, up), 1.0)
        scale = (DEAD_ZONE + (1 - DEAD_ZONE) * length) / math.hypot(right, up) if length > 1e-6 else 0.0
        self.pad.axis(f"{side}_x", right * scale)
        self.pad.axis(f"{side}_y", -up * scale)


_PLUGGED: list[VirtualPad] = []


def unplug_all() -> None:
    """Unplug all gamepads; an SDL that ends before they do crashes."""
    while _PLUGGED:
        _PLUGGED.pop().unplug()


def post(kind: int, **values: object) -> None:
    pygame.event.post(pygame.event.Event(kind, values))


def truth_of(frame: SimulationFrame) -> GroundTruth:
    return GroundTruth(nodes=frame.nodes, contact_portion_true=frame.contact_true, flat_area=frame.flat_area)


def observation_of(frame: SimulationFrame) -> Observation:
    return Observation(
        time_s=frame.sim_s,
        corner_positions=frame.corners,
        holder_position=frame.holder,
        word=frame.word,
        word_strength=frame.word_strength,
        contact_portion=frame.contact,
    )


def headless() -> None:
    """Use SDL without a display and without sound."""
    sdl.prepare()
    os.environ["SDL_VIDEODRIVER"] = "dummy"
    os.environ["SDL_AUDIODRIVER"] = "dummy"
