"""Number of demonstrations, models of another cloth, and other learners."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from layflat.app.report import charts
from layflat.app.report.blocks import Table
from layflat.app.report.comparison_sentences import compare_policies, comparison_sentence
from layflat.app.report.policies import policies_of
from layflat.app.report.table_cells import area_cell, flat_cell, gain_cell, lost_cell, mean_cell, range_cell, values
from layflat.app.report.thesis_numbers import PROPOSED
from layflat.app.reproduce import studies
from layflat.app.reproduce.experiment_output import ExperimentOutput
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.studies import DISTURBANCE, NAPKIN, TOWEL, UNDISTURBED, Trial, of_case
from layflat.data.arrays import FloatArray

HEADER = (
    "", "n", "placed [95\u00a0%\u00a0CI]", "min,\u00a0max", "flat area (min)", "flat after placing",
    "regained, points [95\u00a0%\u00a0CI]", "flat after repair", "lost",
)  # fmt: skip
Samples = dict[str, list[tuple[float, FloatArray]]]


def render_counts(results: ExperimentResults) -> ExperimentOutput:
    """Render contact after placing and what is regained, against the number of demonstrations."""
    output, scale = ExperimentOutput(), results.scale
    placed: Samples = {}
    regained: Samples = {}
    for trial, rows, same in _with_main(results, studies.number_of_demonstrations(scale), output):
        by_count = {count: rows[rows["policy"] == studies.count_name(count)] for count in scale.counts}
        by_count[scale.demonstrations] = same[same["policy"] == PROPOSED] if len(same) else same
        known = {count: part for count, part in by_count.items() if len(part)}
        cells = [(f"{count} demonstration{'s' * (count > 1)}", *_cells(part)) for count, part in known.items()]
        name = f"{trial.robot} robot"
        note = f"{PROPOSED}, {trial.cloth}; the first demonstrations by seed that ended flat, the same starts for all."
        output.add_table(Table(HEADER, tuple(cells)), title=name, note=note)
        placed[name] = [(n, values(of_case(part, UNDISTURBED), "contact_final")) for n, part in known.items()]
        regained[name] = [(n, values(of_case(part, DISTURBANCE), "gain")) for n, part in known.items()]
    if placed:
        panels = {"contact after placing (%)": placed, "regained (points)": regained}
        caption = "Means with their 95 % bootstrap intervals."
        output.blocks.append(charts.means_against(panels, xlabel="demonstrations", caption=caption))
    return output


def render_cloths(results: ExperimentResults) -> ExperimentOutput:
    """Render models of one cloth on the other, beside those of the same cloth."""
    output = ExperimentOutput()
    for trial, rows, same in _with_main(results, studies.other_cloth(results.scale), output):
        other = TOWEL if trial.cloth == NAPKIN else NAPKIN
        cells, findings = [], []
        for policy in policies_of(rows):
            mine, reference = rows[rows["policy"] == policy], same[same["policy"] == policy] if len(same) else same
            if len(same):
                cells.append((f"{policy}, trained on the {trial.cloth}", *_cells(reference)))
                findings.append(_transfer_sentence(policy, mine, reference))
            cells.append((f"{policy}, trained on the {other}", *_cells(mine)))
        output.add_table(Table(HEADER, tuple(cells)), title=f"{trial.robot} robot, tested on the {trial.cloth}")
        output.add_findings(findings)
    return output


def render_comparators(results: ExperimentResults) -> ExperimentOutput:
    """Render other learners that learned from the same demonstrations."""
    output = ExperimentOutput()
    for trial, rows, same in _with_main(results, studies.comparators(results.scale), output):
        both = pd.concat([same, rows], ignore_index=True)
        cells = tuple((policy, *_cells(both[both["policy"] == policy])) for policy in policies_of(both))
        output.add_table(Table(HEADER, cells), title=f"{trial.robot} robot, {trial.cloth}")
        output.add_findings(
            comparison_sentence(PROPOSED, policy, column, compare_policies(part, PROPOSED, policy, column))
            for policy in policies_of(rows)
            for part, column in (
                (of_case(both, UNDISTURBED), "contact_final"),
                (of_case(both, DISTURBANCE), "gain"),
            )
        )
        output.blocks.append(results.curves(trial, of_case(rows, DISTURBANCE)))
    return output


def _with_main(
    results: ExperimentResults, trials: Iterator[Trial], output: ExperimentOutput
) -> Iterator[tuple[Trial, pd.DataFrame, pd.DataFrame]]:
    """Yield each trial with its rows, and those of the main trial of its robot and cloth from the same starts.

    The main trial repeats the disturbance; its first one counts. A trial that was not run is noted in ``output``.
    """
    main = {(t.robot, t.cloth): t for t in (*studies.placing(results.scale), *studies.second_cloth(results.scale))}
    for trial in trials:
        rows = results.rows(trial)
        if not len(rows):
            output.add_missing(f"{trial.robot}, {trial.cloth}")
            continue
        same = results.rows(main[trial.robot, trial.cloth])
        if len(same):
            same = same[same["seed"].isin(set(rows["seed"]))]
            same = same.assign(gain=same["regained_1"]) if "regained_1" in same else same
        yield trial, rows, same


def _cells(rows: pd.DataFrame) -> tuple[str, ...]:
    undisturbed, disturbed = of_case(rows, UNDISTURBED), of_case(rows, DISTURBANCE)
    contact = values(undisturbed, "contact_final")
    return (
        str(len(undisturbed)),
        mean_cell(contact),
        range_cell(contact),
        area_cell(values(undisturbed, "flat_area_final")),
        flat_cell(undisturbed),
        gain_cell(values(disturbed, "gain")),
        flat_cell(disturbed),
        lost_cell(rows),
    )


def _transfer_sentence(policy: str, rows: pd.DataFrame, same: pd.DataFrame) -> str:
    """Compare contact after placing of models of the other cloth with those of the tested one."""
    named = [of_case(part, UNDISTURBED).assign(policy=name) for part, name in ((rows, "other"), (same, "same"))]
    pair = compare_policies(pd.concat(named, ignore_index=True), "other", "same", "contact_final")
    return comparison_sentence(f"{policy} of the other cloth", "that of the same", "contact_final", pair)
