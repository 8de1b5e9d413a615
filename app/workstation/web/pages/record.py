"""Record: demonstrations into a session, by hand, by gamepad, or by the scripted demonstrator."""

from __future__ import annotations

from dataclasses import replace

from layflat.app.support.errors import UsageError
from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.web.folder import SESSION, session_facts
from layflat.app.workstation.web.inputs import SOURCES, gamepad_plugged
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.pages.live import DISTURBED, NEW, LivePage, seed_of
from layflat.app.workstation.web.widgets import put, sentence
from layflat.policy.spec import SCRIPTED
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.sim.tasks import TASKS

RECORDERS = {**SOURCES, SCRIPTED: "the scripted demonstrator, without a person"}


class RecordPage(LivePage):
    """Page of `layflat record`."""

    name = "Record"
    modes = ("record",)
    _job: JobView | None = None

    def build_form(self) -> None:
        now, names = self.workstation.settings, self.folder.sessions()
        self._job = None
        if self.folder.read_only:
            self.note(f"{self.folder.path} cannot be written; look at it in Replay and Data.")
            return
        chosen = self.viewer.shown_session or now.session
        self._session = self.choice("Session", [*names, NEW], chosen if names else NEW, lambda _: self._show_choice())
        self._facts = self.gui.add_html("")
        self._name = self.gui.add_text("Name", _free_name(names), hint="Name of the new session.")
        self._robot = self.choice("Robot", list(ROBOTS), now.robot, lambda _: self._show_choice())
        self._task = self.choice("Task", list(TASKS))
        self._cloth = self.choice("Cloth", list(CLOTHS), now.cloth, lambda _: self._show_choice())
        usable = now.source in RECORDERS and (now.source != "gamepad" or gamepad_plugged(robot_spec(now.robot)))
        source = now.source if usable else "kinesthetic"
        self._source = self.choice("By", list(RECORDERS), source, self._choose_source)
        self._about = self.gui.add_html("")
        self._target = self.gui.add_number("Number to keep", 5, min=1, max=10_000, step=1)
        self._seed = self.gui.add_text("First seed", "", hint="Empty: the next one that the session does not hold.")
        self._button = self.choice("Disturb button", DISTURBED, "push")
        self.button("Begin", self._begin, control=True, color="teal")
        self._job = JobView(self.viewer, "record")
        self._show_choice()
        self._choose_source(source)

    def _choose_source(self, name: str) -> None:
        self.workstation.change_settings(source=name)
        put(self._about, content=sentence(RECORDERS[name]))
        put(self._button, visible=name != SCRIPTED)

    def _show_choice(self) -> None:
        """Offer robot, task and cloth only where the session does not have them yet."""
        self._touched, self.preview, new = True, None, self._session.value == NEW
        for part in (self._name, self._robot, self._task, self._cloth):
            put(part, visible=new)
        config = self._config()
        self.preview = initial_frame(config.robot, config.cloth)
        if new:
            self.workstation.change_settings(robot=config.robot, cloth=config.cloth)
        known = None if new else session_facts(self.folder.session(str(self._session.value)))
        put(self._facts, content=sentence("" if known is None else known.describe()))

    def _config(self) -> SimConfig:
        settings, name = self.workstation.settings, str(self._session.value)
        if name != NEW:
            return replace(session_facts(self.folder.session(name)).config, noise=settings.noise)
        return settings.sim_config(robot=self._robot.value, task=self._task.value, cloth=self._cloth.value)

    def _begin(self) -> None:
        chosen, source = str(self._session.value), str(self._source.value)
        path = self.folder.new(self._name.value, SESSION) if chosen == NEW else self.folder.session(chosen)
        if chosen == NEW and path.name in self.folder.sessions():
            raise UsageError(f"{path.name} exists; choose it above, or another name")
        config, seed, episodes = self._config(), seed_of(self._seed.value), int(self._target.value)
        self.viewer.shown_session = path.name
        self.workstation.change_settings(session=path.name)
        if source == SCRIPTED and self._job is not None:
            options = {"robot": config.robot, "task": config.task, "cloth": config.cloth,
                       "descriptor": config.descriptor, "episodes": episodes, "seed": seed}  # fmt: skip
            given = [word for name, value in options.items() if value is not None for word in (f"--{name}", str(value))]
            images = ["--images"] if self.workstation.settings.images else []
            self._job.start(["record", str(path), "--source", SCRIPTED, *given, *images])
            return
        disturbance = str(self._button.value)
        self.start(
            sim_config=config, source=source, session=path, seed=seed, episodes=episodes, disturbance=disturbance
        )

    def update(self) -> None:
        super().update()
        if not self._keys and self._job is not None and self._job.update():
            self.viewer.rebuild()


def _free_name(names: list[str]) -> str:
    tried = ["demos", *(f"demos-{k}" for k in range(2, len(names) + 3))]
    return next(name for name in tried if f"{name}{SESSION}" not in names)
