"""Place: a policy lays the cloth; the person pulls at it, disturbs it or takes over at any time."""

from __future__ import annotations

from dataclasses import replace

from layflat.app.support.seeds import EVALUATION_SEED
from layflat.app.workers.work_item import WorkItem
from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import Message
from layflat.app.workstation.settings import SPEEDS
from layflat.app.workstation.web.folder import MODEL, SESSION
from layflat.app.workstation.web.inputs import SOURCES
from layflat.app.workstation.web.pages.live import LivePage
from layflat.app.workstation.web.pages.record import NEW, seed_of
from layflat.app.workstation.web.session_facts import session_facts
from layflat.app.workstation.web.widgets import put, sentence
from layflat.policy import model_io
from layflat.policy.registry import RECOMMENDED_WRAPPERS
from layflat.policy.spec import PolicySpec, builtin_names
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.tasks import DEFAULT_TASK

NONE = "none"
WRAPPERS = {NONE: (), **{name: (name,) for name in RECOMMENDED_WRAPPERS}, "both": RECOMMENDED_WRAPPERS}
"""Wrappers around the policy, by their name in the list."""


class PlacePage(LivePage):
    """Page of `layflat place`, with an optional device of a person who may take over."""

    name = "Place"
    modes = ("place", "correct")
    _preview: SimulationFrame | None = None

    def build_form(self) -> None:
        """Add the form."""
        now = self.workstation.settings
        policies = [*self.folder.models(), *builtin_names(DEFAULT_TASK)]
        self._policy = self.choice("Policy", policies, now.model, lambda _: self._show_choice())
        self._facts = self.gui.add_html("")
        self._robot = self.choice("Robot", list(ROBOTS), now.robot, lambda _: self._show_choice())
        self._cloth = self.choice("Cloth", list(CLOTHS), now.cloth, lambda _: self._show_choice())
        self._wrappers = self.choice(
            "Helped by",
            list(WRAPPERS),
            NONE,
            lambda _: None,
            "Wrappers against folds (recovery) and swinging (steady).",
        )
        self._source = self.choice(
            "Take over with", [NONE, *SOURCES], NONE, lambda _: None, "Move to take over; rest to return control."
        )
        self._seed = self.gui.add_text("Seed", str(EVALUATION_SEED))
        self._fast = self.gui.add_checkbox(
            "Place quickly", False, hint="As fast as possible, then it is yours to disturb."
        )
        self._record = self.choice("Record into", [NONE], NONE, self._choose_record)
        self._name = self.gui.add_text("Name", "placed", visible=False, hint="Name of the new session.")
        self.button("Place", self._begin, control=True, color="teal")
        self._show_choice()

    def _choose_record(self, name: str) -> None:
        put(self._name, visible=name == NEW)

    def _show_choice(self) -> None:
        """Offer robot and cloth only to a policy that has none, and only sessions that fit."""
        self._touched, self._preview = True, None
        builtin = not str(self._policy.value).endswith(MODEL)
        put(self._robot, visible=builtin)
        put(self._cloth, visible=builtin)
        try:
            spec, config = self._simulated()
        except Exception as error:
            put(self._facts, content=sentence(str(error), "error"))
            return
        self._preview = initial_frame(config.robot, config.cloth)
        model = spec.model
        text = "" if model is None else f"{config.robot}, {config.cloth}, from {model.demonstrations} demonstrations"
        put(self._facts, content=sentence(text))
        fitting = [] if self.folder.read_only else [name for name in self.folder.sessions() if self._fits(name, config)]
        put(self._record, options=(NONE, *fitting, *([] if self.folder.read_only else [NEW])))

    def preview(self) -> SimulationFrame | None:
        """Return the cloth as it will hang."""
        return self._preview

    def _fits(self, name: str, config: SimConfig) -> bool:
        try:
            return session_facts(self.folder.session(name)).fits(config)
        except Exception:
            return False  # One that cannot be read is none to record into.

    def _simulated(self) -> tuple[PolicySpec, SimConfig]:
        """Return the chosen policy, and the simulation that it needs."""
        settings, name = self.workstation.settings, str(self._policy.value)
        wrappers = WRAPPERS[str(self._wrappers.value)]
        config = replace(settings.sim_config(), robot=str(self._robot.value), cloth=str(self._cloth.value))
        if not name.endswith(MODEL):
            return PolicySpec(builtin=name, wrappers=wrappers), config
        model = model_io.load(self.folder.model(name))
        robot = model.layout.robot.name
        return PolicySpec(model=model, wrappers=wrappers), replace(
            config, robot=robot, cloth=model.cloth, descriptor=model.descriptor
        )

    def _begin(self) -> None:
        settings, record = self.workstation.settings, str(self._record.value)
        spec, config = self._simulated()
        seed = seed_of(self._seed.value)
        seed = EVALUATION_SEED if seed is None else seed
        path = None if record == NONE else self.folder.session(record) if record != NEW else None
        if record == NEW:
            path = self.folder.new(self._name.value, SESSION)
        taught = WorkItem(policy=spec, config=config, seed=seed).is_taught
        self.workstation.change_settings(
            model=str(self._policy.value), robot=str(self._robot.value), cloth=str(self._cloth.value)
        )
        self.start(
            SessionRequest(
                sim_config=config,
                policy=spec,
                source="" if self._source.value == NONE else str(self._source.value),
                session=path,
                seed=seed,
                speed=SPEEDS[settings.speed],
                fast_forward=bool(self._fast.value),
                images=settings.images,
                note=Message(text=f"seed {seed}, from which {spec.label} has learned" if taught else ""),
            )
        )
