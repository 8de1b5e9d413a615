"""PlacePage: a policy places the cloth; the person may drag it, disturb it or take over at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pygame

from layflat.app.support.seeds import EVALUATION_SEED
from layflat.app.workers.work_item import WorkItem
from layflat.app.workstation.session.requests import PlaceRequest
from layflat.app.workstation.settings import SPEEDS
from layflat.app.workstation.teleop.registry import TELEOPERATORS
from layflat.app.workstation.window import style
from layflat.app.workstation.window.context import FormRow, KeyHint, device_key_hints
from layflat.app.workstation.window.pages.activity import ActivityPage
from layflat.app.workstation.window.pages.page import MENU_HINTS
from layflat.policy import model_io
from layflat.policy.registry import RECOMMENDED_WRAPPERS
from layflat.policy.spec import BUILTIN_NAMES, PolicySpec
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import ROBOTS

NAMED = tuple(name for name in DISTURBANCES if name != "none")
"""Disturbances in the order of their keys."""
DIGITS = "1234567890-="
"""Keys of the disturbances; further ones can only be clicked."""
NO_KEY = "•"
NONE = "none"
WRAPPERS = {NONE: (), **{name: (name,) for name in RECOMMENDED_WRAPPERS}, "both": RECOMMENDED_WRAPPERS}
"""Wrappers around the policy, by their name in the menu."""
STATES = {
    "ready": ("Ready", style.TEXT),
    "placing": ("Placing", style.ACCENT),
    "placed": ("Placed", style.CONTACT),
    "disturbing": ("Disturbed", style.WARNING),
    "repairing": ("Repairing", style.WORD),
    "over": ("Ended", style.WARNING),
}


@dataclass
class PlacePage(ActivityPage):
    """Page of `layflat place`, with an optional device of a person who may take over."""

    name: str = "Place"
    seed: int = EVALUATION_SEED
    source: str = NONE
    wrappers: str = NONE
    fast_forward: bool = False
    """Whether to place as fast as possible, and then wait to be disturbed (the Disturb tab)."""
    record: str = ""
    """Session to record into; empty: nothing is recorded."""
    _shown: str | None = None
    """Newest message of the activity that was shown."""

    def build(self) -> None:
        """Make the menu."""
        now, form = self.context.settings, self.new_form(self.name)
        form.note(
            "Places the cloth quickly, for you to disturb." if self.fast_forward else "A policy places the cloth."
        )
        policies = [*self.context.models(), *BUILTIN_NAMES]
        policy = now.model if now.model in policies else policies[0]
        form.choice("Policy", policies, policy, self._choose_policy)
        self._choose_policy(policy)
        if not policy.endswith(".npz"):  # A model has its robot and its cloth.
            form.choice("Robot", list(ROBOTS), now.robot, self.setting("robot"))
            form.choice("Cloth", list(CLOTHS), now.cloth, self.setting("cloth"))
        form.choice("Take over with", [NONE, *TELEOPERATORS], self.source, partial(setattr, self, "source"))
        form.choice(
            "Help against folds and swinging", list(WRAPPERS), self.wrappers, partial(setattr, self, "wrappers")
        )
        form.entry("Seed", str(self.seed), self.set_seed)
        form.entry("Record into (empty: nothing)", self.record, partial(setattr, self, "record"))
        form.button("Place and disturb" if self.fast_forward else "Place", self.start, main=True)

    def _choose_policy(self, policy: str) -> None:
        before = self.context.settings.model
        self.setting("model")(policy)
        if before and before.endswith(".npz") != policy.endswith(".npz"):
            self.context.client.frame = None
            self.rebuild = True

    def start(self) -> None:
        """Start a placement of this seed."""
        request = self._request()
        if request is None or not self.run(request):
            return
        self._shown = None
        self.context.client.request("start")
        item = WorkItem(policy=request.policy, config=request.sim_config, seed=self.seed)
        known = f", which {request.policy.label} was taught" if item.is_taught else ""
        self.context.show_message(f"hanging the cloth of seed {self.seed}{known}")

    def _request(self) -> PlaceRequest | None:
        """Return the request, or None where the model cannot be read, which is shown."""
        settings, name = self.context.settings, self.context.settings.model
        sim_config, wrappers = settings.sim_config(), WRAPPERS[self.wrappers]
        if name.endswith(".npz"):
            try:
                model = model_io.load(self.context.folder / name)
            except (ValueError, OSError) as error:
                self.context.show_message(str(error), style.WARNING)
                return None
            policy = PolicySpec(model=model, wrappers=wrappers)
            robot = model.layout.robot.name
            sim_config = replace(sim_config, robot=robot, cloth=model.cloth, descriptor=model.descriptor)
        else:
            policy = PolicySpec(builtin=name or BUILTIN_NAMES[0], wrappers=wrappers)
        session = self.record if not self.record or self.record.endswith(".h5") else f"{self.record}.h5"
        return PlaceRequest(
            sim_config=sim_config,
            seed=self.seed,
            speed=SPEEDS[settings.speed],
            images=settings.images,
            source="" if self.source == NONE else self.source,
            session=self.context.folder / session if session else None,
            policy=policy,
            fast_forward=self.fast_forward,
        )

    def busy(self) -> str:
        """Return what would be ended by leaving."""
        recording = self.running and self.record and self.status.get("steps")
        return "the recorded episode, and keep its steps as partial" if recording and not self.finished else ""

    def update(self) -> None:
        """Show new messages of the activity."""
        super().update()
        message = self.status.get("message")
        if self.running and not self.finished and message not in (None, self._shown):
            self._shown = message
            self.context.show_message(message)

    def handle_activity_event(self, event: dict[str, Any]) -> None:
        """Show what came of the episode."""
        if event["event"] in ("saved", "discarded"):
            self.finished = True
            self.input_manager.release()
            self.context.show_message(event["line"], style.CONTACT if event["event"] == "saved" else style.QUIET)

    def next_seed(self) -> None:
        """End this episode and start the next seed."""
        self._end()
        self.seed += 1
        self.start()

    def _ask(self, request: str, **values: Any) -> Callable[[], None]:
        return partial(self.context.client.request, request, **values)

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Handle keys."""
        if event.type != pygame.KEYDOWN or not self.running:
            return False
        actions: dict[int, Callable[[], None]] = {
            pygame.K_SPACE: self._ask("pause"),
            pygame.K_k: self._ask("save"),
            pygame.K_x: self._ask("discard"),
            pygame.K_n: self.next_seed,
            pygame.K_ESCAPE: self.stop,
            **{ord(digit): self._ask("disturb", name=name) for digit, name in zip(DIGITS, NAMED, strict=False)},
        }
        action = actions.get(event.key)
        if action is not None:
            action()
        return action is not None

    def accepts_drag(self) -> bool:
        """Return whether the mouse may drag the cloth now."""
        return self.can_drag("placing", "placed", "disturbing", "repairing")

    def key_hints(self) -> list[KeyHint]:
        """Return the effect of each key and of each button of the device now."""
        if not self.running:
            return list(MENU_HINTS)
        # A keyboard that takes over has all keys: their other effects can only be clicked.
        has_keys = self.source in (NONE, "gamepad") or self.finished
        seed = KeyHint("N" if has_keys else NO_KEY, "next seed", self.next_seed)
        hints = [seed, KeyHint("Esc", "end, to the menu", self.stop)]
        if self.finished:
            return hints
        if not self.input_manager.uses_mouse():
            hints.append(KeyHint("drag", "pull at the cloth"))
        for k, name in enumerate(NAMED):
            key = DIGITS[k] if has_keys and k < len(DIGITS) else NO_KEY
            hints.append(KeyHint(key, name, self._ask("disturb", name=name), style.WORD))
        return [*self._episode_hints(), *hints]

    def _episode_hints(self) -> list[KeyHint]:
        """Return what can be done with the episode, by keys or by the buttons of the person's device."""
        if self.source != NONE:
            effects: dict[str, str | None] = self.status.get("effects", {})
            return device_key_hints(self.input_manager.help(), effects, self.context.send_command)
        hints = [KeyHint("Space", "continue" if self.status.get("paused") else "pause", self._ask("pause"))]
        if self.status.get("recording"):
            hints.append(KeyHint("K", "keep", self._ask("save"), style.CONTACT))
            hints.append(KeyHint("X", "discard", self._ask("discard"), style.WARNING))
        return hints

    def headline(self) -> tuple[str, style.Color]:
        """Return the state."""
        if self.finished:
            return "Finished", style.CONTACT
        if self.status.get("paused"):
            return "Paused", style.WORD
        if self.human_in_control:
            return "You are in control", style.HUMAN
        return STATES.get(self.state, ("Hanging the cloth…", style.QUIET))

    def rows(self) -> list[FormRow]:
        """Return numbers of the episode."""
        status, frame = self.status, self.frame()
        time = contact = flat_area = force = ""
        if frame is not None:
            time, contact = f"{frame.sim_s:.1f} s, {frame.step} steps", f"{100 * frame.contact:.1f} %"
            flat_area, force = f"{frame.flat_area:.3f}", f"{np.linalg.norm(frame.force_n):.2f} N"
        n_drag = int(status.get("drag_steps", 0))
        disturbances = [*status.get("disturbances", []), *([f"your drag ({n_drag} steps)"] if n_drag else [])]
        human = [FormRow("you in control", f"{status.get('intervention_steps', 0)} steps", style.HUMAN)]
        return [
            FormRow("policy", str(status.get("policy", Path(self.context.settings.model).stem))),
            FormRow("seed", str(self.seed)),
            FormRow("time", time),
            FormRow("contact", contact, style.CONTACT),
            FormRow("flat area", flat_area),
            FormRow("disturbances", ", ".join(disturbances) or "none so far", style.WORD),
            FormRow("force", force, style.WARNING),
            *(human if status.get("effects") else []),
            FormRow("recorded into", self.record or "no file"),
        ]

    def banner(self) -> tuple[str, str]:
        """Return what the person waits for."""
        if self.running and not self.status and self.context.client.alive:
            return "Hanging the cloth", f"seed {self.seed}"
        if self.running and self.status.get("paused"):
            message = str(self.status.get("message", ""))
            return "Paused", message if message.startswith("paused") else "Space continues"
        return "", ""
