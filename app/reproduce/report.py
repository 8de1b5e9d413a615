"""DIR/report.html and DIR/table.md of a reproduction, from whatever DIR holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from layflat.app.report.blocks import Page, Section, TableBlock
from layflat.app.report.page import OnProgress, write_markdown, write_page
from layflat.app.report.tables import Table
from layflat.app.reproduce.experiment_results import Claim, ExperimentOutput, ExperimentResults
from layflat.app.reproduce.experiments import EXPERIMENTS, Experiment
from layflat.app.reproduce.studies import DISTURBANCE, FIRST_SEED, ScaleConfig
from layflat.app.support.provenance import capture_provenance
from layflat.data.types import Provenance

TITLE = "The thesis's experiments, ours beside its"
CLAIMS_HEADER = ("the thesis says", "where", "thesis", "ours", "agrees")
CLAIMS_NOTE = (
    "Agrees: a number where it lies in our 95 % interval of the mean (\u201cin part\u201d: within our range); a "
    "share where nine in ten of our episodes do the same "
    "(\u201cin part\u201d: half); a difference where the paired interval says so."
)


def write_reports(out: Path, material: ExperimentResults, *, on_progress: OnProgress | None = None) -> Path:
    """Write both; ``step`` hears of each experiment. Returns the page's path."""
    say = on_progress or (lambda text: None)
    shown: list[tuple[Experiment, ExperimentOutput]] = []
    for experiment in EXPERIMENTS.values():
        shown.append((experiment, experiment.show(material)))
        say(experiment.name)
    page = page_of(shown, material.size, capture_provenance())
    write_markdown(out / "table.md", page)
    write_page(out / "report.html", page)
    return out / "report.html"


def page_of(shown: Sequence[tuple[Experiment, ExperimentOutput]], size: ScaleConfig, provenance: Provenance) -> Page:
    """The page: what agrees first, then each experiment."""
    claims = [claim for _, each in shown for claim in each.claims]
    overview = Section(
        id="agrees",
        title="What agrees, and what does not",
        blocks=(TableBlock(table=claims_table(claims), note=CLAIMS_NOTE, wordy=True),),
    )
    sections = [
        Section(
            id=experiment.name,
            title=experiment.title,
            short=experiment.name.replace("-", " "),
            lead=experiment.lead,
            blocks=each.blocks,
        )
        for experiment, each in shown
    ]
    return Page(
        title=TITLE,
        lead=_lead(size),
        sections=(overview, *sections),
        made=(
            provenance.command,
            f"{provenance.created_utc} (UTC), {provenance.platform}",
            ", ".join(f"{name} {number}" for name, number in provenance.versions.items()),
        ),
    )


def claims_table(claims: Sequence[Claim]) -> Table:
    """One line per claim."""
    lines = tuple((claim.what, claim.source, claim.thesis, claim.ours, claim.holds) for claim in claims)
    return Table(CLAIMS_HEADER, lines, (True,) * len(lines))


def _lead(size: ScaleConfig) -> str:
    return (
        f"A {size.name} reproduction in simulation: {size.seeds} starts of each experiment of the thesis, "
        f"{size.sweep_seeds} of each point of a sweep, from "
        f"seed {FIRST_SEED} on, which were not looked at while anything was tuned; every model learned from "
        f"{size.demonstrations} scripted demonstrations "
        "unless it says otherwise. Every policy meets the same starts and the same disturbances "
        f"(\u201c{DISTURBANCE}\u201d: a hand pushes the cloth from the "
        "middle to the front). Intervals are 95 % bootstrap intervals over starts."
    )
