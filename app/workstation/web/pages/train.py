"""Train: a model from the successful demonstrations of a session, by `layflat train` in the background."""

from __future__ import annotations

import html
from functools import partial
from pathlib import Path

from layflat.app.media.plot_style import VARIABLES
from layflat.app.report.attractor_field import field_figure
from layflat.app.workstation.web.folder import MODEL, session_facts
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.viewer import Page
from layflat.app.workstation.web.widgets import put, sentence
from layflat.data.session.reader import open_session
from layflat.policy import model_io
from layflat.policy.registry import TRAINABLE_POLICIES
from layflat.policy.trained_model import RegressionModel

INKS = {"ink": "currentColor", "muted": "currentColor", "line": "rgba(128,128,128,.5)", "card": "transparent"}
"""Colors of a plot that follow the page's theme."""


class TrainPage(Page):
    """Page of `layflat train`."""

    name = "Train"

    def build(self) -> None:
        self._session = self.session_choice()
        if not self._session:
            return
        outcomes = session_facts(self.folder.session(self._session)).outcomes
        n = outcomes.count("success")
        text = f"{n} of {len(outcomes)} episodes are successes, and are used"
        self.gui.add_html(sentence(text, "info" if n else "warning"))
        policy = self.workstation.settings.policy
        self._policy = self.choice("Policy", list(TRAINABLE_POLICIES), policy, self._choose_policy)
        self._model = self.gui.add_text("Model", self._proposed(), hint="Name of the file to write.")
        hint = "Weight of steps in which a person corrected a policy."
        self._weight = self.gui.add_number("Corrections count", 1, min=1, max=100, step=1, hint=hint)
        self._force = self.gui.add_checkbox("Replace it if it exists", False)
        self.button("Train", self._train, control=True, color="teal")
        self._job = JobView(self.viewer, "train")
        self._plot = self.gui.add_html("")
        if self._job.succeeded:
            self._show_plot()

    def _proposed(self) -> str:
        return f"{self._session.removesuffix('.h5')}-{self.workstation.settings.policy}"

    def _choose_policy(self, name: str) -> None:
        proposed = self._model.value == self._proposed()
        self.workstation.change_settings(policy=name)
        if proposed:
            put(self._model, value=self._proposed())

    def _train(self) -> None:
        model, weight = self.folder.new(self._model.value, MODEL), int(self._weight.value)
        put(self._plot, content="")
        arguments = ["train", str(self.folder.session(self._session)), str(model), "--policy", str(self._policy.value)]
        arguments += ["--intervention-weight", str(weight)] if weight != 1 else []
        self._job.start([*arguments, *(["--force"] if self._force.value else [])])

    def update(self) -> None:
        """Show the command, what was learned, and choose its model for placing."""
        if self._session and self._job.update() and self._job.succeeded:
            self.workstation.change_settings(model=self._trained()[1].name)
            self.viewer.say("the model is chosen on the page Place", "success")
            self._show_plot()

    def _trained(self) -> tuple[Path, Path]:
        """Return session and model of the newest command."""
        assert self._job.job is not None
        return Path(self._job.job.arguments[1]), Path(self._job.job.arguments[2])

    def _show_plot(self) -> None:
        self.viewer.background(partial(field_plot, *self._trained()), lambda plot: put(self._plot, content=plot))


def field_plot(session: Path, model: Path) -> str:
    """Return a plot of what a model has learned, with the demonstrations, as HTML; a sentence for other kinds."""
    trained = model_io.load(model)
    if not isinstance(trained, RegressionModel):
        return sentence("this kind of model has no field to be drawn; its numbers are above")
    with open_session(session) as opened:
        shown = list(opened.view(opened.select(outcome="success"), images=False))
    figure = field_figure({trained.policy: trained}, shown)
    inks = {name: color for color, name in VARIABLES.items()} | INKS
    style = ";".join(f"--{name}:{color}" for name, color in inks.items())
    plot = figure.panels[0].replace(
        "<svg ", f'<svg role="img" aria-label="{html.escape(figure.alt)}" style="width:100%;height:auto" ', 1
    )
    return f'<div style="{style}">{plot}</div>{sentence(figure.caption)}'
