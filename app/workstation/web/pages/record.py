"""Record: demonstrations into a session, by hand, by gamepad, or by the scripted demonstrator."""

from __future__ import annotations

from collections.abc import Callable

from layflat.app.support.errors import UsageError
from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.settings import SPEEDS
from layflat.app.workstation.web.folder import SESSION
from layflat.app.workstation.web.inputs import SOURCES, gamepad_plugged
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.pages.live import LivePage
from layflat.app.workstation.web.session_facts import session_facts
from layflat.app.workstation.web.widgets import put, sentence
from layflat.policy.spec import SCRIPTED
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.sim.tasks import TASKS

NEW = "new session"
RECORDERS = {**SOURCES, SCRIPTED: "the scripted demonstrator, without a person"}


class RecordPage(LivePage):
    """Page of `layflat record`."""

    name = "Record"
    modes = ("record",)
    _preview: SimulationFrame | None = None

    def build_form(self) -> None:
        """Add the form."""
        now, names = self.workstation.settings, self.folder.sessions()
        if self.folder.read_only:
            self.note(f"{self.folder.path} cannot be written; look at it in Replay and Data.")
            return
        chosen = self.viewer.shown_session or now.session
        self._session = self.choice("Session", [*names, NEW], chosen if names else NEW, lambda _: self._show_choice())
        self._facts = self.gui.add_html("")
        self._name = self.gui.add_text("Name", _free_name(names), hint="Name of the new session.")
        self._robot = self.choice("Robot", list(ROBOTS), now.robot, self._set("robot"))
        self._task = self.choice("Task", list(TASKS), next(iter(TASKS)), lambda _: None)
        self._cloth = self.choice("Cloth", list(CLOTHS), now.cloth, self._set("cloth"))
        plugged = gamepad_plugged(robot_spec(now.robot))
        source = now.source if now.source in RECORDERS else "kinesthetic"
        self._source = self.choice(
            "By", list(RECORDERS), source if plugged or source != "gamepad" else "kinesthetic", self._choose_source
        )
        self._about = self.gui.add_html("")
        self._target = self.gui.add_number("Number to keep", 5, min=1, max=10_000, step=1)
        self._seed = self.gui.add_text("First seed", "", hint="Empty: the next one that the session does not hold.")
        named = [name for name in DISTURBANCES if name != "none"]
        self._disturb = self.choice("Disturb button", named, "push", lambda _: None)
        self.button("Begin", self._begin, control=True, color="teal")
        self._job = JobView(self.viewer, "record")
        self._show_choice()
        self._choose_source(str(self._source.value))

    def _set(self, name: str) -> Callable[[str], None]:
        def change(value: str) -> None:
            self.workstation.change_settings(**{name: value})
            self._show_choice()

        return change

    def _choose_source(self, name: str) -> None:
        self.workstation.change_settings(source=name)
        put(self._about, content=sentence(RECORDERS[name]))
        put(self._disturb, visible=name != SCRIPTED)

    def preview(self) -> SimulationFrame | None:
        """Return the cloth as it will hang."""
        return self._preview

    def _show_choice(self) -> None:
        """Offer robot, task and cloth only where the session does not have them yet."""
        self._touched, self._preview = True, None
        config = self._config()
        self._preview = initial_frame(config.robot, config.cloth)
        new = self._session.value == NEW
        for part in (self._name, self._robot, self._task, self._cloth):
            put(part, visible=new)
        text = "" if new else session_facts(self.folder.session(str(self._session.value))).describe()
        put(self._facts, content=sentence(text))

    def _config(self) -> SimConfig:
        settings, name = self.workstation.settings, str(self._session.value)
        if name != NEW:
            return session_facts(self.folder.session(name)).sim_config(noise=settings.noise)
        return SimConfig(
            robot=str(self._robot.value), task=str(self._task.value), cloth=str(self._cloth.value),
            descriptor=settings.descriptor, noise=settings.noise, step_s=settings.step_s,
        )  # fmt: skip

    def _begin(self) -> None:
        settings, chosen, source = self.workstation.settings, str(self._session.value), str(self._source.value)
        path = self.folder.new(self._name.value, SESSION) if chosen == NEW else self.folder.session(chosen)
        if chosen == NEW and path.name in self.folder.sessions():
            raise UsageError(f"{path.name} exists; choose it above, or another name")
        config, seed = self._config(), seed_of(self._seed.value)
        self.viewer.shown_session = path.name
        self.workstation.change_settings(session=path.name)
        if source == SCRIPTED:
            options = {"robot": config.robot, "task": config.task, "cloth": config.cloth,
                       "descriptor": config.descriptor, "episodes": int(self._target.value), "seed": seed}  # fmt: skip
            given = [word for name, value in options.items() if value is not None for word in (f"--{name}", str(value))]
            images = ["--images"] if settings.images else []
            self._job.start(["record", str(path), "--source", SCRIPTED, *given, *images])
            return
        self.start(
            SessionRequest(
                sim_config=config,
                source=source,
                session=path,
                seed=seed,
                episodes=int(self._target.value),
                disturbance=str(self._disturb.value),
                speed=SPEEDS[settings.speed],
                images=settings.images,
                countdown_s=settings.countdown_s,
            )
        )

    def update(self) -> None:
        """Show the newest status, and the new session when a scripted recording has ended."""
        super().update()
        if self._panel is None and hasattr(self, "_job") and self._job.update():
            self.viewer.rebuild()


def seed_of(text: str) -> int | None:
    """Return the seed that a person wrote, or None for an empty text; UsageError for anything else."""
    if not text.strip():
        return None
    if not text.strip().isdecimal() or int(text) >= 2**32:
        raise UsageError(f"the seed is {text!r}; it must be a whole number from 0 to {2**32 - 1}")
    return int(text)


def _free_name(names: list[str]) -> str:
    tried = ["demos", *(f"demos-{k}" for k in range(2, len(names) + 3))]
    return next(name for name in tried if f"{name}{SESSION}" not in names)
