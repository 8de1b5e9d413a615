"""`layflat data info|validate|stats`: contents, violations and statistics of a session."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from layflat.app.support import validators
from layflat.app.support.console import console
from layflat.app.support.errors import UsageError, say
from layflat.app.support.metrics import write_json
from layflat.app.support.session_lines import copies_text, names_text
from layflat.data import validate as find_violations
from layflat.data.format import schema
from layflat.data.format.demo_info import DemoInfo
from layflat.data.session.reader import Session, open_session
from layflat.data.tools.episode_index import FLAGS, episode_index, flag_counts
from layflat.data.tools.stats import ColumnStats, session_stats
from layflat.data.types import OUTCOMES, DisturbanceRecord

ROWS_MAX = 20
"""Episodes that a page lists one by one; of more, the first and the last."""
COLUMNS_MAX = 12
"""Columns of a data set that are listed one by one: cloth nodes have hundreds."""
RANGES: Mapping[str, tuple[str, Callable[[float], str]]] = {
    "steps": ("n_steps", "{:.0f}".format),
    "contact at start": ("contact_start", "{:.1%}".format),
    "contact at end": ("contact_final", "{:.1%}".format),
    "mesh contact at end": ("contact_final_true", "{:.1%}".format),
    "flat area at end": ("flat_area_final", "{:.3f}".format),
}
"""Ranges on the page: title -> attribute of DemoInfo, format."""


def info(path: Path, *, json: Path | None, force: bool) -> None:
    """Print a page on the session."""
    if json is not None:
        validators.writable_file(json, force=force, suffix=".json")
    with open_session(path) as session:
        print_page(session, session.infos(), console(highlight=False))
        print_edits(session, console(highlight=False))
        if copies := session.copies():
            print(f"{copies_text(copies)}; `layflat data merge {path} --out NEW.h5` keeps one of each")
        if json is not None:
            write_json(json, info_report(session, session.infos()))


def validate(path: Path, *, json: Path | None, force: bool) -> None:
    """Print each violation with its path; UsageError where there is one."""
    validators.readable_file(path, "a session that was recorded by layflat")
    if json is not None:
        validators.writable_file(json, force=force, suffix=".json")
    found, copies = find_violations(path), dict[str, str]()
    if not found:
        with open_session(path) as session:
            copies = session.copies()
    for violation in found:
        print(f"{violation.path}: {violation.message}")
    if json is not None:
        violations = [vars(violation) for violation in found]
        write_json(json, {"file": str(path), "valid": not found, "violations": violations, "copies": copies})
    if found:
        count = "one violation" if len(found) == 1 else f"{len(found)} violations"
        raise UsageError(f"{path} has {count}; `layflat data repair` saves the intact episodes, if there are any")
    print(f"valid {path}")
    if copies:
        say(f"{path}: {copies_text(copies)}")


def stats(path: Path, *, json: Path | None, force: bool) -> None:
    """Print statistics of every data set."""
    if json is not None:
        validators.writable_file(json, force=force, suffix=".json")
    with open_session(path) as session:
        found, robot = session_stats(session), session.robot
    table = Table("data set", "column", "unit", "count", "minimum", "maximum", "mean", "std")
    for key, column in found.columns.items():
        names = schema.columns_of(schema.FIELDS[key], robot)
        for number, (name, row) in enumerate(column_rows(column, names)):
            table.add_row(key if number == 0 else "", name, column.unit, str(column.count), *row)
    console(highlight=False).print(table)
    if json is not None:
        report = {"file": str(path), "steps": found.n_steps, **vars(found)}
        report["columns"] = {key: vars(column) for key, column in found.columns.items()}
        write_json(json, _plain({key: value for key, value in report.items() if key != "n_steps"}))


def _plain(value: Any) -> Any:
    """Return a value as JSON takes it: arrays as lists, NaN as null."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return [_plain(item) for item in value.tolist()]
    return None if isinstance(value, float) and np.isnan(value) else value


# The page


def print_page(session: Session, infos: Mapping[str, DemoInfo], out: Console) -> None:
    """Print the session, counts, ranges, and the episodes one by one as far as they fit."""
    rows = list(infos.values())
    n_steps, seconds = sum(row.n_steps for row in rows), sum(row.duration_s for row in rows)
    out.print(f"{session.path}: {len(rows)} episodes, {n_steps} steps, {seconds:.0f} s simulated", markup=False)
    out.print(
        f"robot {session.robot}, task {session.task}, cloth {session.cloth}, physics {session.physics},"
        f" step {session.step_s} s, descriptor {session.descriptor}, images in {sum(row.images for row in rows)}",
        markup=False,
    )
    outcomes = Counter(row.outcome for row in rows)
    out.print("outcome: " + ", ".join(f"{outcomes[name]} {name}" for name in OUTCOMES if outcomes[name]), markup=False)
    for key in ("source", "disturbance", "stopped_by", "operator"):
        counts = Counter(str(getattr(row, key)) or "unknown" for row in rows)
        out.print(f"{key.replace('_', ' ')}: " + ", ".join(f"{n} {name}" for name, n in counts.items()), markup=False)
    table = Table("", "least", "median", "most")
    for title, (key, text) in RANGES.items():
        values = [value for value in (getattr(row, key) for row in rows) if value is not None]
        if values:
            table.add_row(title, *(text(value) for value in np.quantile(values, [0.0, 0.5, 1.0])))
    out.print(table)
    out.print(episode_table(infos, session.disturbances))


def print_edits(session: Session, out: Console) -> None:
    """Print what edits have changed, and which episodes a person should look at."""
    if session.edits:
        dropped = f", {len(session.dropped)} dropped: {', '.join(session.dropped)}" if session.dropped else ""
        text = f"edits: {len(session.edits)} episodes{dropped}; `layflat data edit {session.path} log` lists them"
        out.print(text, markup=False)
    for flag, names in flag_counts(episode_index(session)).items():
        out.print(f"{flag}: {names_text(names)} ({FLAGS[flag]})", markup=False)
    for name, info in session.infos().items():
        if info.note:
            out.print(f"note on {name}: {info.note}", markup=False)


def episode_table(
    infos: Mapping[str, DemoInfo], disturbances: Callable[[str], Sequence[DisturbanceRecord]] = lambda name: ()
) -> Table:
    """Return a table of episodes; ``disturbances`` is called for the disturbed ones that are shown."""
    table = Table("episode", "seed", "source", "outcome", "stopped by", "disturbance", "steps", "contact", "flat area")
    names = list(infos)
    shown = names if len(names) <= ROWS_MAX else [*names[: ROWS_MAX // 2], "", *names[-ROWS_MAX // 2 :]]
    for name in shown:
        if not name:
            table.add_row(f"... {len(names) - ROWS_MAX} more")
            continue
        row = infos[name]
        contact = f"{100 * row.contact_start:.0f} to {100 * row.contact_final:.0f} %"
        undisturbed = row.disturbance == "none"
        disturbed = row.disturbance if undisturbed else disturbances_text(row.disturbance, disturbances(name))
        cells = (str(row.seed), row.source, row.outcome, row.stopped_by, disturbed, str(row.n_steps), contact)
        table.add_row(name, *cells, "" if row.flat_area_final is None else f"{row.flat_area_final:.3f}")
    return table


def disturbances_text(suite: str, records: Sequence[DisturbanceRecord]) -> str:
    """Return disturbances with their first steps: "thesis at 61, 95", "gusts: wind at 5, push at 40"."""
    first_steps: dict[str, list[str]] = {}
    for record in records:
        first_steps.setdefault(record.name, []).append(str(record.first_step))
    parts = ", ".join(f"{name} at {', '.join(steps)}" for name, steps in first_steps.items())
    return parts if list(first_steps) == [suite] else ": ".join(filter(None, (suite, parts)))


def info_report(session: Session, infos: Mapping[str, DemoInfo]) -> dict[str, Any]:
    """Return the page as a JSON object."""

    def episode(name: str, info: DemoInfo) -> dict[str, Any]:
        records = session.disturbances(name) if info.disturbance != "none" else ()
        row = {key: value for key, value in vars(info).items() if key not in ("n_steps", "action_axes")}
        times = [{key: getattr(record, key) for key in ("name", "first_step", "last_step")} for record in records]
        return {"name": name, "steps": info.n_steps, **row, "flags": flags[name], "disturbances": times}

    flags = {row.name: row.flags for row in episode_index(session)}

    return {
        "file": str(session.path),
        **session.shared,
        "action_axes": session.robot.action_names,
        "steps": sum(row.n_steps for row in infos.values()),
        "outcomes": Counter(row.outcome for row in infos.values()),
        "sources": Counter(row.source for row in infos.values()),
        "copies": session.copies(),
        "dropped": list(session.dropped),
        "episodes": [episode(name, row) for name, row in infos.items()],
    }


def column_rows(column: ColumnStats, names: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Return name, minimum, maximum, mean and deviation of each column as text; many nameless ones are one row."""
    values = np.array([column.min, column.max, column.mean, column.std])
    if values.shape[1] > COLUMNS_MAX:
        mean = column.mean.mean()
        pooled = np.sqrt((column.std**2 + (column.mean - mean) ** 2).mean())
        values = np.array([[column.min.min()], [column.max.max()], [mean], [pooled]])
        names = [f"all {len(column.mean)}"]
    return [
        (names[number] if number < len(names) else "", [f"{value:.6g}" for value in one])
        for number, one in enumerate(values.T)
    ]
