"""Every experiment: its question, the trials that it needs, and its rendering. A new one adds a value here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from layflat.app.reproduce import studies
from layflat.app.reproduce.experiment_output import ExperimentOutput
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.field import render_field
from layflat.app.reproduce.flattening import render_flattening
from layflat.app.reproduce.inputs import render_inputs
from layflat.app.reproduce.placing import render_bad_contact, render_disturbance, render_folded_corner, render_placing
from layflat.app.reproduce.studies import ScaleConfig, Trial
from layflat.app.reproduce.sweeps import render_cloths, render_comparators, render_counts


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One section of the page."""

    name: str
    title: str
    lead: str
    """Description of the experiment, the thesis's and ours."""
    priority: int
    """Order in which trials are run, the least first; several experiments may need the same trials."""
    trials: tuple[Callable[[ScaleConfig], Iterator[Trial]], ...]
    render: Callable[[ExperimentResults], ExperimentOutput]

    def plan(self, scale: ScaleConfig) -> list[Trial]:
        """Return the trials at a scale."""
        return [trial for make_trials in self.trials for trial in make_trials(scale)]


EXPERIMENTS: Mapping[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        Experiment(
            name="flattening",
            title="Figures 3-5 to 3-8: wrinkle removal",
            lead="Two pickers on the table pull a crumpled cloth flat: along WORD (Algorithm 2), to the right, or at "
            "random. Thesis: one run each in SoftGym.",
            priority=2,
            trials=(studies.flattening,),
            render=render_flattening,
        ),
        Experiment(
            name="field",
            title="Figure 4-1: the learned field",
            lead="What a model predicts in the xz plane, and how sure it is. Thesis: the baseline, five "
            "demonstrations with a gamepad.",
            priority=1,
            trials=(studies.placing,),
            render=render_field,
        ),
        Experiment(
            name="placing",
            title="Figures 4-2 and 4-3, Table 4-1: placing",
            lead="From hanging in the air until the policy stops. Thesis: one run each in SoftGym, then a robot "
            "trained ten times by hand.",
            priority=1,
            trials=(studies.placing,),
            render=render_placing,
        ),
        Experiment(
            name="disturbance",
            title="Figures 4-4 and 4-5, Table 4-2: disturbance",
            lead="After the stop a hand wrinkles the cloth, and the policy repairs it; then once more. Models are "
            "tested on the cloth they learned from. Thesis: a mouse in SoftGym, a stick on the robot's two cloths.",
            priority=4,
            trials=(studies.placing, studies.second_cloth),
            render=render_disturbance,
        ),
        Experiment(
            name="bad-contact",
            title="Figure 5-1: a bad first contact",
            lead="The cloth meets the table with its reverse side first. Thesis: one run, which stays at 79.39 %.",
            priority=6,
            trials=(studies.bad_contact,),
            render=render_bad_contact,
        ),
        Experiment(
            name="folded-corner",
            title="Figure 5-2: a folded corner",
            lead="A hand folds a corner of the free edge over after the policy has stopped. Thesis: one run; the robot "
            "pulls, and stops with the fold still there.",
            priority=1,
            trials=(studies.placing,),
            render=render_folded_corner,
        ),
        Experiment(
            name="inputs",
            title="What each input adds",
            lead="The same learner without WORD, without the contact portion, without both, and the baseline with a "
            "rule of three lines that repairs.",
            priority=3,
            trials=(studies.placing, studies.inputs),
            render=render_inputs,
        ),
        Experiment(
            name="counts",
            title="Number of demonstrations",
            lead="The proposed method, trained on few and on many. The thesis has five (simulation), ten (robot).",
            priority=7,
            trials=(studies.placing, studies.number_of_demonstrations),
            render=render_counts,
        ),
        Experiment(
            name="cloths",
            title="Taught on one cloth, tested on the other",
            lead="Models of the towel (cloth 1) on the napkin (cloth 2), and the other way round.",
            priority=8,
            trials=(studies.placing, studies.second_cloth, studies.other_cloth),
            render=render_cloths,
        ),
        Experiment(
            name="comparators",
            title="Other learners",
            lead="The thesis's chapter 5-3 names DMP and GMM as what GPs should be compared with; the nearest "
            "demonstrated action stands below all of them.",
            priority=9,
            trials=(studies.placing, studies.comparators),
            render=render_comparators,
        ),
    )
}
"""By name, in the order of the page."""
