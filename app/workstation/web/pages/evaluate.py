"""Evaluate: policies compared from the same starts, by `layflat evaluate` in the background, and its report."""

from __future__ import annotations

import html
import json
import time

from layflat.app.evaluation.suites import shipped
from layflat.app.support.errors import UsageError
from layflat.app.support.seeds import EVALUATION_SEED
from layflat.app.workstation.web.folder import foreign_policy
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.viewer import Page
from layflat.app.workstation.web.widgets import put, sentence, table
from layflat.policy.spec import SCRIPTED
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import ROBOTS

NONE = "none"
MODELS_MAX = 12
REPORT_MAX = 40_000_000
"""Largest report that is shown in place, bytes."""
WIDE = """<style>.mantine-Modal-content {flex: 0 0 92vw !important}
iframe {width: 100%; height: 75vh; border: 0}</style>"""


class EvaluatePage(Page):
    """Page of `layflat evaluate`."""

    name = "Evaluate"

    def build(self) -> None:
        if not self.folder.read_only:
            names = (*self.folder.models()[:MODELS_MAX], SCRIPTED)
            with self.gui.add_folder("Policies"):
                self._policies = {name: self.gui.add_checkbox(name, False) for name in names}
                hint = "package.module:factory, names of entry points, or ws://HOST:PORT, with spaces between them"
                self._own = self.gui.add_text("Your own", "", hint=hint)
            now, hint = self.workstation.settings, "Where no model is ticked, which brings its own."
            self._robot = self.choice("Robot", list(ROBOTS), now.robot, hint=hint)
            self._cloth = self.choice("Cloth", list(CLOTHS), now.cloth, hint=hint)
            suites = [NONE, *shipped(), *(name for name in DISTURBANCES if name not in (NONE, *shipped()))]
            self._suite = self.choice("Disturbed by", suites)
            self._episodes = self.gui.add_number("Starts", 10, min=1, max=10_000, step=1)
            self._videos = self.gui.add_checkbox("Films", False, hint="Best, median and worst of each policy.")
            self._name = self.gui.add_text("Folder", f"evaluation-{time.strftime('%m%d-%H%M')}")
            self.button("Evaluate", self._evaluate, control=True, color="teal")
        self._job = JobView(self.viewer, "evaluate")
        results = self.folder.results()
        if results:
            self._result = self.choice("Results", results, results[0], lambda _: self._show())
            self._table = self.gui.add_html("")
            self.button("Show the report", self._report)
            self._show()

    def _evaluate(self) -> None:
        chosen = [name for name, box in self._policies.items() if box.value]
        policies = [name if name == SCRIPTED else str(self.folder.model(name)) for name in chosen]
        policies += [foreign_policy(text) for text in self._own.value.split()]
        if not policies:
            raise UsageError("no policy is chosen; tick at least one")
        arguments = [*policies, "--episodes", str(int(self._episodes.value)), "--seed", str(EVALUATION_SEED)]
        if set(chosen) <= {SCRIPTED}:
            arguments += ["--robot", str(self._robot.value), "--cloth", str(self._cloth.value)]
        arguments += ["--disturb", str(self._suite.value)] if self._suite.value != NONE else []
        arguments += ["--videos"] if self._videos.value else []
        self._job.start(["evaluate", *arguments, "--out", str(self.folder.new(self._name.value))])

    def update(self) -> None:
        """Show the command, and its results when it has ended."""
        if self._job.update():
            self.viewer.rebuild()

    def _show(self) -> None:
        """Show the groups of the chosen results."""
        path = self.folder.result(str(self._result.value)) / "summary.json"
        try:
            groups = json.loads(path.read_text())["groups"]
        except (OSError, ValueError, KeyError):
            put(self._table, content=sentence("not complete; the same evaluation continues it", "warning"))
            return
        rows = [
            [str(one["policy"]), f"{one['robot']}, {one['cloth']}", str(one["disturbance"]), str(one["n"]),
             _percent(one["contact_final"]["mean"]), _percent(one["success_rate"])]
            for one in groups
        ]  # fmt: skip
        put(self._table, content=table(["policy", "with", "disturbed by", "n", "contact", "success"], rows))

    def _report(self) -> None:
        """Show the report above everything; its own page is not trusted with scripts."""
        path = self.folder.result(str(self._result.value)) / "report.html"
        if not path.is_file():
            raise UsageError(f"{path.parent.name} has no report yet; run the same evaluation to complete it")
        if path.stat().st_size > REPORT_MAX:
            raise UsageError(f"{path} is too large to be shown here; open it in a browser")
        page = html.escape(path.read_text(encoding="utf-8"), quote=True)
        with self.gui.add_modal(f"Report of {path.parent.name}"):
            self.gui.add_html(f'{WIDE}<iframe title="Report" sandbox srcdoc="{page}"></iframe>')


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"
