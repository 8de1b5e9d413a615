"""`layflat data info|validate|stats`: what a session holds, what is wrong with it, and its numbers."""

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
from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import write_json
from layflat.data.format import schema
from layflat.data.robot import RobotSpec
from layflat.data.session.demo_info import DemoInfo
from layflat.data.session.reader import Session, open_session
from layflat.data.tools.stats import ColumnStats, session_stats
from layflat.data.tools.validate import validate as violations_of
from layflat.data.types import OUTCOMES, DisturbanceRecord

ROWS_MAX = 20
"""Episodes that a page lists one by one; of more, the first and the last."""
COLUMNS_MAX = 12
"""Columns of a data set that are listed one by one: cloth nodes have hundreds."""


def info(path: Path, *, json: Path | None, force: bool) -> None:
    """A page on the session."""
    if json is not None:
        validators.writable_file(json, force=force)
    with open_session(path) as session:
        infos = session.infos()
        print_page(session, infos, console(highlight=False))
        if json is not None:
            write_json(json, info_report(session, infos))


def validate(path: Path, *, json: Path | None, force: bool) -> None:
    """Print each violation with its path; UsageError where there is one."""
    validators.readable_file(path, "a session that was recorded by layflat")
    if json is not None:
        validators.writable_file(json, force=force)
    found = violations_of(path)
    for violation in found:
        print(f"{violation.path}: {violation.sentence}")
    if json is not None:
        rows = [{"path": violation.path, "sentence": violation.sentence} for violation in found]
        write_json(json, {"file": str(path), "valid": not found, "violations": rows})
    if found:
        count = "one violation" if len(found) == 1 else f"{len(found)} violations"
        raise UsageError(f"{path} has {count}; `layflat data repair` saves what is whole")
    print(f"valid {path}")


def stats(path: Path, *, json: Path | None, force: bool) -> None:
    """Statistics of everything that was recorded."""
    if json is not None:
        validators.writable_file(json, force=force)
    with open_session(path) as session:
        found, names = session_stats(session), column_names(session.robot)
    table = Table("data set", "column", "unit", "count", "minimum", "maximum", "mean", "std")
    for key, column in found.columns.items():
        for number, (name, row) in enumerate(column_rows(column, names[key])):
            table.add_row(key if number == 0 else "", name, column.unit, str(column.count), *row)
    console(highlight=False).print(table)
    if json is not None:
        write_json(json, {"file": str(path), **plain_stats(found)})


# The page


def print_page(session: Session, infos: Mapping[str, DemoInfo], out: Console) -> None:
    """Session, counts, ranges, and the episodes one by one as far as they fit."""
    rows = list(infos.values())
    n_steps = [row.n_steps for row in rows]
    seconds = sum(row.duration_s for row in rows)
    out.print(f"{session.path}: {len(rows)} episodes, {sum(n_steps)} steps, {seconds:.0f} s simulated", markup=False)
    out.print(
        f"robot {session.robot}, cloth {session.cloth}, step {session.step_s} s, descriptor {session.descriptor},"
        f" schema {_listed(row.version for row in rows)}, images in {sum(row.images for row in rows)}",
        markup=False,
    )
    outcomes = Counter(row.outcome for row in rows)
    out.print("outcome: " + ", ".join(f"{outcomes[name]} {name}" for name in OUTCOMES if outcomes[name]), markup=False)
    for what in ("source", "disturbance", "stopped_by", "operator"):
        counts = Counter(str(getattr(row, what)) or "not told" for row in rows)
        out.print(f"{what.replace('_', ' ')}: " + ", ".join(f"{n} {name}" for name, n in counts.items()), markup=False)
    table = Table("", "least", "median", "most")
    for what, values in ranges(rows).items():
        low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
        table.add_row(what, *(_number(what, value) for value in (low, middle, high)))
    out.print(table)
    out.print(episode_table(infos, session.disturbances))


def ranges(rows: Sequence[DemoInfo]) -> dict[str, list[float]]:
    """What the page gives the range of, by its name there."""
    return {
        "steps": [float(row.n_steps) for row in rows],
        "contact at start": [row.contact_start for row in rows],
        "contact at end": [row.contact_final for row in rows],
        "mesh contact at end": [row.contact_true_final for row in rows],
        "flat area at end": [row.flat_area_final for row in rows],
    }


def episode_table(
    infos: Mapping[str, DemoInfo], befell: Callable[[str], Sequence[DisturbanceRecord]] = lambda name: ()
) -> Table:
    """``befell`` is asked of the disturbed episodes that are shown."""
    table = Table("episode", "seed", "source", "outcome", "stopped by", "disturbance", "steps", "contact", "flat area")
    names = list(infos)
    shown = names if len(names) <= ROWS_MAX else [*names[: ROWS_MAX // 2], "", *names[-ROWS_MAX // 2 :]]
    for name in shown:
        if not name:
            table.add_row(f"... {len(names) - ROWS_MAX} more")
            continue
        row = infos[name]
        contact = f"{100 * row.contact_start:.0f} to {100 * row.contact_final:.0f} %"
        disturbed = row.disturbance if row.disturbance == "none" else told(row.disturbance, befell(name))
        cells = (str(row.seed), row.source, row.outcome, row.stopped_by, disturbed, str(row.n_steps), contact)
        table.add_row(name, *cells, f"{row.flat_area_final:.3f}")
    return table


def told(disturbance: str, befell: Sequence[DisturbanceRecord]) -> str:
    """Which disturbances, and when they began: "thesis at 61, 95", "gusts: wind at 5, push at 40"."""
    first_steps: dict[str, list[str]] = {}
    for record in befell:
        first_steps.setdefault(record.name, []).append(str(record.first_step))
    parts = ", ".join(f"{name} at {', '.join(begun)}" for name, begun in first_steps.items())
    return parts if list(first_steps) == [disturbance] else ": ".join(filter(None, (disturbance, parts)))


def info_report(session: Session, infos: Mapping[str, DemoInfo]) -> dict[str, Any]:
    """The page as a JSON object."""

    def befell(name: str) -> list[dict[str, Any]]:
        if infos[name].disturbance == "none":
            return []
        keys = ("name", "first_step", "last_step")
        return [{key: getattr(record, key) for key in keys} for record in session.disturbances(name)]

    return {
        "file": str(session.path),
        "robot": session.robot.name,
        "cloth": session.cloth,
        "step_s": session.step_s,
        "descriptor": session.descriptor,
        "steps": sum(row.n_steps for row in infos.values()),
        "outcomes": Counter(row.outcome for row in infos.values()),
        "sources": Counter(row.source for row in infos.values()),
        "episodes": [{"name": name, **vars(row), "disturbances": befell(name)} for name, row in infos.items()],
    }


def _listed(values: Any) -> str:
    return " and ".join(str(value) for value in sorted(set(values)))


def _number(what: str, value: float) -> str:
    return f"{100 * value:.1f} %" if "contact" in what else f"{value:.3f}" if "area" in what else f"{value:.0f}"


# Statistics


def column_names(robot: RobotSpec) -> dict[str, tuple[str, ...]]:
    """Names of the columns of each data set; empty where they have none."""
    return {field.key: schema.columns_of(field, robot) for field in schema.FIELDS}


def column_rows(column: ColumnStats, names: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Name, minimum, maximum, mean and standard deviation of each column, as text; many nameless ones are one row."""
    values = np.array([column.minimum, column.maximum, column.mean, column.std])
    if values.shape[1] > COLUMNS_MAX:
        mean = column.mean.mean()
        pooled = np.sqrt((column.std**2 + (column.mean - mean) ** 2).mean())
        values = np.array([[column.minimum.min()], [column.maximum.max()], [mean], [pooled]])
        names = [f"all {len(column.mean)}"]
    return [
        (names[number] if number < len(names) else "", [f"{value:.6g}" for value in one])
        for number, one in enumerate(values.T)
    ]


def plain_stats(found: Any) -> dict[str, Any]:
    """As JSON takes it; a column of which nothing is known has empty lists."""
    columns = {
        key: {
            "unit": column.unit,
            "count": column.count,
            "min": column.minimum.tolist(),
            "max": column.maximum.tolist(),
            "mean": column.mean.tolist(),
            "std": column.std.tolist(),
        }
        for key, column in found.columns.items()
    }
    return {**{key: value for key, value in vars(found).items() if key != "columns"}, "columns": columns}
