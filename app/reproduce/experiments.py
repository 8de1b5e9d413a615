"""Every experiment: what it asks, which trials it needs, and how it is shown. A new one adds a value here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from layflat.app.reproduce import disturbance, field, flattening, inputs, limits, placing, studies, sweeps
from layflat.app.reproduce.experiment_results import ExperimentOutput, ExperimentResults
from layflat.app.reproduce.studies import ScaleConfig, Trial


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One section of the page."""

    name: str
    title: str
    lead: str
    """What was done, there and here."""
    urgency: int
    """Whose trials are run first: the least; several may need the same ones."""
    needs: tuple[Callable[[ScaleConfig], Iterator[Trial]], ...]
    show: Callable[[ExperimentResults], ExperimentOutput]

    def trials(self, size: ScaleConfig) -> list[Trial]:
        return [trial for need in self.needs for trial in need(size)]


EXPERIMENTS: Mapping[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        Experiment(
            name="flattening",
            title="Figures 3-5 to 3-8: wrinkle removal",
            lead="Two pickers on the table pull a crumpled cloth flat: along WORD (Algorithm 2), to the right, or at "
            "random. Thesis: one run each in SoftGym.",
            urgency=2,
            needs=(studies.flattening,),
            show=flattening.show,
        ),
        Experiment(
            name="field",
            title="Figure 4-1: the learned field",
            lead="What a model predicts in the xz plane, and how sure it is. Thesis: the baseline, five "
            "demonstrations with a gamepad.",
            urgency=1,
            needs=(studies.placing,),
            show=field.show,
        ),
        Experiment(
            name="placing",
            title="Figures 4-2 and 4-3, Table 4-1: placing",
            lead="From hanging in the air until the policy stops. Thesis: one run each in SoftGym, then a robot "
            "taught ten times by hand.",
            urgency=1,
            needs=(studies.placing,),
            show=placing.show,
        ),
        Experiment(
            name="disturbance",
            title="Figures 4-4 and 4-5, Table 4-2: disturbance",
            lead="After the stop a hand wrinkles the cloth, the policy goes on; then once more. Thesis: a mouse in "
            "SoftGym, a stick on the robot's two cloths.",
            urgency=4,
            needs=(studies.placing, studies.second_cloth),
            show=disturbance.show,
        ),
        Experiment(
            name="bad-contact",
            title="Figure 5-1: a bad first contact",
            lead="The cloth meets the table with its reverse side first. Thesis: one run, which stays at 79.39 %.",
            urgency=6,
            needs=(studies.bad_contact,),
            show=limits.show_bad_contact,
        ),
        Experiment(
            name="folded-corner",
            title="Figure 5-2: a folded corner",
            lead="A hand folds a corner of the free edge over after the policy has stopped. Thesis: one run; the robot "
            "pulls, and stops with the fold still there.",
            urgency=1,
            needs=(studies.placing,),
            show=limits.show_folded_corner,
        ),
        Experiment(
            name="inputs",
            title="What each input adds",
            lead="The same learner without WORD, without the contact portion, without both, and the baseline with a "
            "rule of three lines that repairs.",
            urgency=3,
            needs=(studies.placing, studies.inputs),
            show=inputs.show,
        ),
        Experiment(
            name="counts",
            title="Number of demonstrations",
            lead="The proposed method taught with few and with many. The thesis has five (simulation) and ten (robot).",
            urgency=7,
            needs=(studies.placing, studies.number_of_demonstrations),
            show=sweeps.show_counts,
        ),
        Experiment(
            name="cloths",
            title="Taught on one cloth, tested on the other",
            lead="Models of the towel (cloth 1) on the napkin (cloth 2), and the other way round.",
            urgency=8,
            needs=(studies.placing, studies.second_cloth, studies.other_cloth),
            show=sweeps.show_cloths,
        ),
        Experiment(
            name="comparators",
            title="Other learners",
            lead="The thesis's chapter 5-3 names DMP and GMM as what GPs should be compared with; the nearest "
            "demonstrated action stands below all of them.",
            urgency=9,
            needs=(studies.placing, studies.comparators),
            show=sweeps.show_comparators,
        ),
    )
}
"""By name, in the order of the page."""
