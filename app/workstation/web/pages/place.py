"""Place: a policy lays the cloth; the person pulls at it, disturbs it or takes over at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from layflat.app.support.seeds import EVALUATION_SEED
from layflat.app.workers.work_item import WorkItem
from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.status import Message
from layflat.app.workstation.web.folder import MODEL, SESSION, foreign_policy, session_facts
from layflat.app.workstation.web.inputs import SOURCES
from layflat.app.workstation.web.pages.live import NEW, NONE, LivePage, seed_of
from layflat.app.workstation.web.widgets import put, sentence
from layflat.policy import model_io
from layflat.policy.registry import RECOMMENDED_WRAPPERS
from layflat.policy.spec import PolicySpec, builtin_names
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.tasks import DEFAULT_TASK

OWN = "one of your own"
WRAPPERS = {NONE: (), **{name: (name,) for name in RECOMMENDED_WRAPPERS}, "both": RECOMMENDED_WRAPPERS}
"""Wrappers around the policy, by their name in the list."""


class PlacePage(LivePage):
    """Page of `layflat place`, with an optional device of a person who may take over."""

    name = "Place"
    modes = ("place", "correct")

    def build_form(self) -> None:
        now = self.workstation.settings
        policies = [*self.folder.models(), *builtin_names(DEFAULT_TASK), OWN]
        self._policy = self.choice("Policy", policies, now.model, lambda _: self._show_choice())
        hint = "package.module:factory, the name of an entry point, or ws://HOST:PORT"
        self._own = self.gui.add_text("Its name", now.own_policy, visible=False, hint=hint)
        self._facts = self.gui.add_html("")
        self._robot = self.choice("Robot", list(ROBOTS), now.robot, lambda _: self._show_choice())
        self._cloth = self.choice("Cloth", list(CLOTHS), now.cloth, lambda _: self._show_choice())
        hint = "Wrappers against folds (recovery) and swinging (steady)."
        self._wrappers = self.choice("Helped by", list(WRAPPERS), hint=hint)
        hint = "Move to take over; rest to return control."
        self._source = self.choice("Take over with", [NONE, *SOURCES], hint=hint)
        self._seed = self.gui.add_text("Seed", str(EVALUATION_SEED))
        hint = "As fast as possible, then it is yours to disturb."
        self._fast = self.gui.add_checkbox("Place quickly", False, hint=hint)
        self._record = self.choice("Record into", [NONE], NONE, lambda name: put(self._name, visible=name == NEW))
        # Its options change with the policy.
        self.viewer.on_change(self._record, lambda: put(self._name, visible=self._record.value == NEW))
        self._name = self.gui.add_text("Name", "placed", visible=False, hint="Name of the new session.")
        self.button("Place", self._begin, control=True, color="teal")
        self._show_choice()

    def _show_choice(self) -> None:
        """Offer robot and cloth only to a policy that has none, and only sessions that fit."""
        self._touched, self.preview, chosen = True, None, str(self._policy.value)
        put(self._own, visible=chosen == OWN)
        for part in (self._robot, self._cloth):
            put(part, visible=not chosen.endswith(MODEL))
        if chosen == OWN:
            self._show_config(PolicySpec(builtin="hold"))
        else:
            self.viewer.background(self._read_policy(), self._show_config)

    def _show_config(self, spec: PolicySpec) -> None:
        config, model = self._config(spec), spec.model
        self.preview = initial_frame(config.robot, config.cloth)
        text = "" if model is None else f"{config.robot}, {config.cloth}, from {model.demonstrations} demonstrations"
        put(self._facts, content=sentence(text))
        fitting = [name for name in self.folder.sessions() if self._fits(name, config)]
        put(self._record, options=(NONE,) if self.folder.read_only else (NONE, *fitting, NEW))

    def _fits(self, name: str, config: SimConfig) -> bool:
        try:
            return session_facts(self.folder.session(name)).config == replace(config, noise=False)
        except Exception:
            return False  # One that cannot be read is none to record into.

    def _read_policy(self) -> Callable[[], PolicySpec]:
        """Return what reads the chosen policy; one of the person's own may take long to import."""
        name, wrappers = str(self._policy.value), WRAPPERS[str(self._wrappers.value)]
        if name == OWN:
            text = foreign_policy(self._own.value)
            return lambda: PolicySpec.parse("+".join((text, *wrappers)))
        if not name.endswith(MODEL):
            return lambda: PolicySpec(builtin=name, wrappers=wrappers)
        path = self.folder.model(name)
        return lambda: PolicySpec(model=model_io.load(path), wrappers=wrappers)

    def _config(self, spec: PolicySpec) -> SimConfig:
        """Return the simulation that a policy needs."""
        config = self.workstation.settings.sim_config(robot=self._robot.value, cloth=self._cloth.value)
        if spec.model is None:
            return config
        model = spec.model
        return replace(config, robot=model.layout.robot.name, cloth=model.cloth, descriptor=model.descriptor)

    def _begin(self) -> None:
        record, seed = str(self._record.value), seed_of(self._seed.value)
        path = None if record == NONE else self.folder.session(record) if record != NEW else None
        if record == NEW:
            path = self.folder.new(self._name.value, SESSION)
        chosen = {"model": str(self._policy.value), "own_policy": self._own.value}
        read = self._read_policy()
        self.workstation.change_settings(robot=self._robot.value, cloth=self._cloth.value, **chosen)
        first = EVALUATION_SEED if seed is None else seed
        self.viewer.background(read, lambda spec: self._start(spec, path, first), always=True)

    def _start(self, spec: PolicySpec, path: Path | None, seed: int) -> None:
        config, source = self._config(spec), "" if self._source.value == NONE else str(self._source.value)
        taught = WorkItem(policy=spec, config=config, seed=seed).is_taught
        note = Message(text=f"seed {seed}, from which {spec.label} has learned" if taught else "")
        fast = bool(self._fast.value)
        self.start(sim_config=config, policy=spec, source=source, session=path, seed=seed, fast_forward=fast, note=note)
