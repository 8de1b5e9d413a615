"""Train: a model from the successful demonstrations of a session, by `layflat train` in the background."""

from __future__ import annotations

from layflat.app.workstation.web.folder import MODEL
from layflat.app.workstation.web.job_view import JobView
from layflat.app.workstation.web.pages.page import Page
from layflat.app.workstation.web.session_facts import session_facts
from layflat.app.workstation.web.widgets import put, sentence
from layflat.policy.registry import TRAINABLE_POLICIES


class TrainPage(Page):
    """Page of `layflat train`."""

    name = "Train"

    def build(self) -> None:
        """Add the page's parts."""
        self._session = self.session_choice(self.viewer.shown_session, self._choose_session, "Demonstrations")
        if not self._session:
            return
        self._used = self.gui.add_html("")
        policy = self.workstation.settings.policy
        self._policy = self.choice("Policy", list(TRAINABLE_POLICIES), policy, self._choose_policy)
        self._model = self.gui.add_text("Model", self._proposed(), hint="Name of the file to write.")
        self._weight = self.gui.add_number(
            "Corrections count", 1, min=1, max=100, step=1, hint="Weight of steps in which a person corrected a policy."
        )
        self._force = self.gui.add_checkbox("Replace it if it exists", False)
        self.button("Train", self._train, control=True, color="teal")
        self._job = JobView(self.viewer, "train")
        self._show_used()

    def _proposed(self) -> str:
        return f"{self._session.removesuffix('.h5')}-{self.workstation.settings.policy}"

    def _choose_session(self, name: str) -> None:
        self.viewer.shown_session = name
        self.viewer.rebuild()

    def _choose_policy(self, name: str) -> None:
        proposed = self._model.value == self._proposed()
        self.workstation.change_settings(policy=name)
        if proposed:
            put(self._model, value=self._proposed())

    def _show_used(self) -> None:
        outcomes = session_facts(self.folder.session(self._session)).outcomes
        n = outcomes.count("success")
        text = f"{n} of {len(outcomes)} episodes are successes, and are used"
        put(self._used, content=sentence(text, "info" if n else "warning"))

    def _train(self) -> None:
        model, weight = self.folder.new(self._model.value, MODEL), int(self._weight.value)
        arguments = ["train", str(self.folder.session(self._session)), str(model), "--policy", str(self._policy.value)]
        arguments += ["--intervention-weight", str(weight)] if weight != 1 else []
        self._job.start([*arguments, *(["--force"] if self._force.value else [])])

    def update(self) -> None:
        """Show the command, and choose its model for placing."""
        if self._session and self._job.update() and self._job.job is not None and self._job.job.status == 0:
            self.workstation.change_settings(model=self.folder.new(self._model.value, MODEL).name)
            self.viewer.say("the model is chosen on the page Place", "success")
