"""DIR/report.html and DIR/table.md of a reproduction, from the content of DIR."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from layflat.app.report.blocks import Page, Section, Table, TableBlock
from layflat.app.report.page import OnProgress, markdown, no_progress, write_page
from layflat.app.reproduce.claims import Claim
from layflat.app.reproduce.experiment_output import ExperimentOutput
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.experiments import EXPERIMENTS, Experiment
from layflat.app.reproduce.studies import DISTURBANCE, FIRST_SEED, ScaleConfig
from layflat.data.atomic_files import write_text
from layflat.data.provenance import capture_provenance
from layflat.data.types import Provenance

TITLE = "The thesis's experiments, ours beside its"
CLAIMS_HEADER = ("the thesis says", "where", "thesis", "ours", "agrees")
CLAIMS_NOTE = (
    "Agrees: a number where it lies in our 95 % interval of the mean (\u201cin part\u201d: within our range); a "
    "share where nine in ten of our episodes do the same (\u201cin part\u201d: half); a difference where the paired "
    "interval says so."
)


def write_reports(out: Path, results: ExperimentResults, *, on_progress: OnProgress = no_progress) -> Path:
    """Write both files; return the page's path."""
    outputs: list[tuple[Experiment, ExperimentOutput]] = []
    for experiment in EXPERIMENTS.values():
        outputs.append((experiment, experiment.render(results)))
        on_progress(0.5 / len(EXPERIMENTS), experiment.name)
    page = page_of(outputs, results.scale, capture_provenance())
    write_text(out / "table.md", markdown(page))
    write_page(out / "report.html", page, on_progress=on_progress)
    return out / "report.html"


def page_of(outputs: Sequence[tuple[Experiment, ExperimentOutput]], scale: ScaleConfig, provenance: Provenance) -> Page:
    """Return the page: the claims first, then each experiment."""
    claims = [claim for _, output in outputs for claim in output.claims]
    table = TableBlock(table=claims_table(claims), note=CLAIMS_NOTE, wordy=True)
    overview = Section(id="agrees", title="What agrees, and what does not", blocks=(table,))
    sections = [
        Section(
            id=experiment.name,
            title=experiment.title,
            short=experiment.name.replace("-", " "),
            lead=experiment.lead,
            blocks=tuple(output.blocks),
        )
        for experiment, output in outputs
    ]
    return Page(
        title=TITLE,
        lead=_lead(scale),
        sections=(overview, *sections),
        provenance=(
            provenance.command,
            f"{provenance.created_utc} (UTC), {provenance.platform}",
            ", ".join(f"{name} {number}" for name, number in provenance.versions.items()),
        ),
    )


def claims_table(claims: Iterable[Claim]) -> Table:
    """Make one line for each claim."""
    return Table(CLAIMS_HEADER, tuple((c.what, c.source, c.thesis, c.ours, c.agrees) for c in claims))


def _lead(scale: ScaleConfig) -> str:
    return (
        f"A {scale.name} reproduction in simulation: {scale.seeds} starts of each experiment of the thesis, "
        f"{scale.sweep_seeds} of each point of a sweep, from seed {FIRST_SEED} on, which were not looked at while "
        f"anything was tuned; every model learned from {scale.demonstrations} scripted demonstrations unless it says "
        f"otherwise. Every policy meets the same starts and the same disturbances (\u201c{DISTURBANCE}\u201d: a hand "
        "pushes the cloth from the middle to the front). Intervals are 95 % bootstrap intervals over starts."
    )
