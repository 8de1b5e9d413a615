"""Experiments that place a cloth: Tables 4-1 and 4-2, and the limits of chapter 5-1 (Figures 5-1 and 5-2)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import pandas as pd

from layflat.app.evaluation.summary import with_measures
from layflat.app.report import thesis_numbers as thesis
from layflat.app.report.blocks import Table
from layflat.app.report.comparison_sentences import compare_policies, comparison_sentence
from layflat.app.report.policies import policies_of
from layflat.app.report.table_cells import difference_cell, flat_cell, gain_cell, mean_cell, values
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.report.thesis_tables import DISTURBANCE_NOTE, PLACING_NOTE, TURNS, disturbance_table, placing_table
from layflat.app.reproduce import studies
from layflat.app.reproduce.claims import (
    NO,
    PART,
    UNKNOWN,
    YES,
    Claim,
    agrees_by_share,
    agrees_by_value,
    contact_sentence,
    too_few,
)
from layflat.app.reproduce.experiment_output import ExperimentOutput
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.studies import DISTURBANCE, FOLD, UNDISTURBED, Trial, of_case
from layflat.app.support.formatting import percent, points
from layflat.app.support.statistics import confidence_interval
from layflat.data.arrays import FloatArray

FULL_CONTACT = 0.99
"""Contact portion that counts as 100 %: the camera's noise takes some tenths of a percent."""
LIMITS_NOTE = (
    "Contact portion of the camera at the end; a folded part hides from it, which is why flat area, of the mesh, "
    "stands beside it."
)


def render_placing(results: ExperimentResults) -> ExperimentOutput:
    """Render Figures 4-2 and 4-3 and Table 4-1."""
    trials = studies.placing(results.scale)
    return _render(
        results, trials, UNDISTURBED, placing_table, PLACING_NOTE, _placing_claims, compared=("contact_final",)
    )


def render_disturbance(results: ExperimentResults) -> ExperimentOutput:
    """Render Figures 4-4, 4-5, 4-9 and 4-10 and Table 4-2: two disturbances in turn, on two cloths."""
    trials = (*studies.placing(results.scale), *studies.second_cloth(results.scale))
    compared = ("regained_1", "regained_2", "flat_area_final")
    return _render(
        results, trials, DISTURBANCE, disturbance_table, DISTURBANCE_NOTE, _disturbance_claims, compared=compared
    )


def render_bad_contact(results: ExperimentResults) -> ExperimentOutput:
    """Render Figure 5-1: a cloth whose reverse side touches the table first."""
    stated = thesis.BAD_CONTACT
    claims = partial(_limit_claims, what="a bad first contact", source=stated.source, stated=percent(stated.value))
    trials, table = studies.bad_contact(results.scale), partial(placing_table, cite=False)
    return _render(results, trials, UNDISTURBED, table, LIMITS_NOTE, claims, pick=_least_and_most_flat)


def render_folded_corner(results: ExperimentResults) -> ExperimentOutput:
    """Render Figure 5-2: a corner that a hand folds over after the placing."""
    source, stated = "chapter 5-1, Figure 5-2", thesis.FOLDED_CORNER
    claims = partial(_limit_claims, what="a folded corner", source=source, stated=stated)
    trials, table = studies.placing(results.scale), partial(disturbance_table, cite=False)
    return _render(results, trials, FOLD, table, LIMITS_NOTE, claims, pick=_least_and_most_flat)


def _render(
    results: ExperimentResults,
    trials: Iterable[Trial],
    disturbance: str,
    table: Callable[[pd.DataFrame], Table],
    note: str,
    claims: Callable[[Trial, pd.DataFrame], Iterator[Claim]],
    *,
    compared: Sequence[str] = (),
    pick: Callable[[pd.DataFrame], Sequence[int]] | None = None,
) -> ExperimentOutput:
    """Render a table, the differences in the ``compared`` columns with curves, and strips, for each trial."""
    output = ExperimentOutput()
    for trial in trials:
        rows = of_case(results.rows(trial), disturbance)
        output.claims += claims(trial, rows)
        if not len(rows):
            output.add_missing(f"{trial.robot}, {trial.cloth}")
            continue
        output.add_table(table(rows), title=f"{trial.robot} robot, {trial.cloth}", note=note)
        if compared:
            output.add_findings(
                comparison_sentence(PROPOSED, BASELINE, column, compare_policies(rows, PROPOSED, BASELINE, column))
                for column in compared
                if column in rows
            )
            output.blocks.append(results.curves(trial, rows))
        for policy in policies_of(rows):
            output.blocks += results.strips(trial, policy, disturbance, pick)
    return output


def _least_and_most_flat(rows: pd.DataFrame) -> list[int]:
    order = rows["flat_area_final"].to_numpy(float).argsort()
    return [int(order[0]), int(order[-1])] if len(order) > 1 else list(range(len(order)))


def _placing_claims(trial: Trial, rows: pd.DataFrame) -> Iterator[Claim]:
    for policy, stated in thesis.PLACING_SIMULATED.items():
        found = values(rows, "contact_final", policy)
        n_full = int((found >= FULL_CONTACT).sum())
        yield Claim(
            what=f"{policy} places to 100 % in simulation ({trial.robot})",
            source=stated.source,
            thesis=percent(stated.value),
            ours=f"{mean_cell(found)}; {n_full} of {len(found)} at 99 % or more" if len(found) else UNKNOWN,
            agrees=too_few(found) or agrees_by_share(n_full, len(found)),
        )
    for policy, (_, mean, _) in thesis.PLACING.items():
        found = values(rows, "contact_final", policy)
        yield Claim(
            what=f"mean contact of {policy} after placing ({trial.robot})",
            source=thesis.PLACING_SOURCE,
            thesis=percent(mean),
            ours=contact_sentence(found),
            agrees=too_few(found) or agrees_by_value(mean, found),
        )
    pair = compare_policies(rows, PROPOSED, BASELINE, "contact_final")
    yield Claim(
        what=f"in placing the two do not differ ({trial.robot})",
        source="chapters 4-2-2, 4-3-2",
        thesis="no significant difference",
        ours=difference_cell(pair) if pair.n else UNKNOWN,
        agrees=too_few(pair) or (NO if pair.is_significant else YES),
    )


def _disturbance_claims(trial: Trial, rows: pd.DataFrame) -> Iterator[Claim]:
    where = f"{trial.robot}, {trial.cloth}"
    for policy, stated in thesis.REGAINED_CLAIM.items():
        reported = thesis.regained(policy)
        for k, turn in enumerate(TURNS[: max(trial.repeats, 1)], start=1):
            found = values(rows, f"regained_{k}", policy)
            yield Claim(
                what=f"{policy} regains after the {turn} disturbance ({where})",
                source=f"chapter 4-3-3, {thesis.DISTURBANCE_SOURCE}",
                thesis=f"{stated} ({points(min(reported))} to {points(max(reported))})",
                ours=f"{gain_cell(found)}, n = {len(found)}" if len(found) else UNKNOWN,
                agrees=too_few(found) or (_regains_nothing if policy == BASELINE else _regains_five)(found),
            )
    found = values(rows, "contact_final", PROPOSED)
    left = int((found < FULL_CONTACT).sum())
    yield Claim(
        what=f"{PROPOSED} does not remove every wrinkle ({where})",
        source="chapters 4-2-3, 4-3-3, 5-1",
        thesis="88.99 to 95.32 % at the end",
        ours=f"{mean_cell(found)}; {left} of {len(found)} below 99 %" if len(found) else UNKNOWN,
        agrees=too_few(found) or (YES if left >= 0.9 * len(found) else PART if left > 0.1 * len(found) else NO),
    )


def _regains_nothing(found: FloatArray) -> str:
    low, high = confidence_interval(found)
    return YES if max(-low, high) < 0.01 else PART if abs(found.mean()) < 0.01 else NO


def _regains_five(found: FloatArray) -> str:
    low, _ = confidence_interval(found)
    if low > 0.10:
        return f"{YES}, and more"
    return YES if low >= 0.05 else PART if found.mean() >= 0.05 else NO


def _limit_claims(trial: Trial, rows: pd.DataFrame, *, what: str, source: str, stated: str) -> Iterator[Claim]:
    for policy in policies_of(rows) or (PROPOSED,):
        mine = rows[rows["policy"] == policy] if len(rows) else rows
        contact = values(mine, "contact_final")
        n_wrinkled = len(mine) - int(with_measures(mine)["success"].sum()) if len(mine) else 0
        yield Claim(
            what=f"{policy} does not flatten {what} ({trial.robot})",
            source=source,
            thesis=stated,
            ours=f"{contact_sentence(contact)}; flat {flat_cell(mine)}" if len(mine) else UNKNOWN,
            agrees=too_few(contact) or agrees_by_share(n_wrinkled, len(mine)),
        )
