"""`layflat bench`: how fast this machine simulates, sees, predicts and keeps, beside what the project promises."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from layflat.app.benchmarks import measure, measure_batch, measure_data, measure_perception, measure_solver_settings
from layflat.app.support import validators
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.app.workers.process import process_pool
from layflat.app.workers.work_item import LIMIT_S
from layflat.data.arrays import FloatArray
from layflat.data.provenance import capture_provenance
from layflat.data.types import STEP_S
from layflat.sim.robots.registry import ROBOTS

CLOTH, FINE_CLOTH = "towel", "towel-fine"
AIR_GOAL, TABLE_GOAL = 1.5, 1.0
"""Simulated over wall time that one core is to reach with the default cloth."""
SEEING_GOALS = {"seeing": 1.0, "fine seeing": 0.7}
"""The same with camera, perception and recording, by the kind of measurement: the default cloth, and the fine one."""
RTF = "sim s / wall s"
PER_STEP = "ms / step"
PERCEPT_GOAL_S = 0.004
"""Of one core for one frame: masks, contact and word-axial."""
SECONDS = {
    "physics": 10.0,
    "fine physics": 18.0,
    "seeing": 12.0,
    "fine seeing": 20.0,
    "sight": 6.0,
    "predicting": 4.0,
    "recipes": 25.0,
    "batch": 70.0,
    **measure_data.SECONDS,
}
"""Expected wall time of each kind of measurement."""


@dataclass(frozen=True, kw_only=True)
class BenchmarkRow:
    """One line of the table."""

    name: str
    value: float
    """Median of the repeats."""
    unit: str
    baseline: float | None = None
    """What it is to be seen beside, in the same unit: a goal, bare substeps, or the default cloth."""
    samples: int = 1
    """How many repeats or blocks."""

    @property
    def ratio(self) -> float | None:
        """value / baseline."""
        return None if self.baseline is None else self.value / self.baseline


@dataclass(frozen=True, kw_only=True)
class BenchmarkResult:
    """One fresh process."""

    kind: str
    robot: str
    cloth: str
    work: Callable[..., dict[str, FloatArray]]
    arguments: tuple[object, ...]
    forks: bool = False
    """It makes processes itself."""

    @property
    def title(self) -> str:
        return f"{self.kind}, {self.robot}, {self.cloth}"


def bench(json: Path | None, *, force: bool) -> list[BenchmarkRow]:
    """Measure everything in fresh processes, one at a time; a table on stdout, and ``json`` where asked for."""
    if json is not None:
        validators.writable_file(json, force=force)
    rows: list[BenchmarkRow] = []
    plan = list(measurements(json.parent if json is not None else None))
    with Progress({item.title: SECONDS[item.kind] for item in plan}) as progress:
        for item in plan:
            progress.phase(item.title)
            rows += rows_of(item, measured(item), rows)
    if json is not None:
        write_json(json, content(rows))
    show(rows)
    return rows


def measured(item: BenchmarkResult) -> dict[str, FloatArray]:
    """What came of it: in a process of its own, or, where it makes its own processes, from here."""
    if item.forks:
        return item.work(*item.arguments)
    with process_pool(1) as pool:
        samples: dict[str, FloatArray] = pool.schedule(item.work, args=item.arguments, timeout=LIMIT_S).result()
    return samples


def measurements(folder: Path | None) -> Iterator[BenchmarkResult]:
    """What is measured, in order; episodes are kept in ``folder``, so that its disk is timed, or a temporary one."""
    for kind, cloth in (
        ("physics", CLOTH),
        ("seeing", CLOTH),
        ("fine physics", FINE_CLOTH),
        ("fine seeing", FINE_CLOTH),
    ):
        for robot in ROBOTS:
            if kind in SEEING_GOALS:
                yield BenchmarkResult(
                    kind=kind, robot=robot, cloth=cloth, work=measure.seeing, arguments=(robot, cloth, folder)
                )
            else:
                blocks = measure.BLOCKS if cloth == CLOTH else measure.FEWER_BLOCKS
                yield BenchmarkResult(
                    kind=kind, robot=robot, cloth=cloth, work=measure.physics, arguments=(robot, cloth, blocks)
                )
    yield BenchmarkResult(
        kind="sight", robot=next(iter(ROBOTS)), cloth=CLOTH, work=measure_perception.sight, arguments=()
    )
    for robot in ROBOTS:
        yield BenchmarkResult(kind="predicting", robot=robot, cloth=CLOTH, work=measure.predicting, arguments=(robot,))
    for across in measure_solver_settings.ACROSS:
        yield BenchmarkResult(
            kind="recipes",
            robot=next(iter(ROBOTS)),
            cloth=f"{across} x {across}",
            work=measure_solver_settings.recipes,
            arguments=(across, CLOTH),
        )
    for kind, work in (("recording", measure_data.recording), ("opening", measure_data.opening)):
        yield BenchmarkResult(kind=kind, robot=measure_data.ROBOT, cloth=CLOTH, work=work, arguments=(folder,))
    robot = next(iter(ROBOTS))
    yield BenchmarkResult(
        kind="batch", robot=robot, cloth=CLOTH, work=measure_batch.scaling, arguments=(robot, CLOTH, folder), forks=True
    )


def rows_of(item: BenchmarkResult, samples: dict[str, FloatArray], before: list[BenchmarkRow]) -> list[BenchmarkRow]:
    """The lines that a measurement makes; ``before`` holds those of the default cloth."""
    prefix = f"{item.robot} {item.cloth}"
    if item.kind in measure_data.SECONDS:
        lines = measure_data.lines_of(item.kind, samples)
        return [BenchmarkRow(name=name, value=v, unit=unit, baseline=b, samples=n) for name, v, unit, b, n in lines]
    if item.kind == "predicting":
        name = f"{item.robot} GP, {measure.GP_POINTS} points / GPy"
        return [_beside(name, samples["predict"], samples["GPy"], "ms")]
    if item.kind == "recipes":
        return [_faster(*line) for line in measure_solver_settings.lines_of(int(str(item.arguments[0])), samples)]
    if item.kind == "batch":
        return [_more_workers(samples)]
    if item.kind == "sight":
        return _sight_rows(samples)
    if item.kind in SEEING_GOALS:
        where = f"{prefix} seen and recorded"
        goal = SEEING_GOALS[item.kind]
        return [
            _rtf(f"{where}, flat", samples["flat"], goal),
            _rtf(f"{where}, dragged", samples["drag"], goal),
            _plain(f"{prefix} camera frame", samples["capture"], 1e3, "ms"),
            _plain(f"{prefix} perception", samples["perceive"], 1e3, "ms"),
            _plain(f"{prefix} keep of {measure.EPISODE_STEPS} steps", samples["keep"], 1e3, "ms"),
        ]
    goals = {"in the air": AIR_GOAL, "dragged": TABLE_GOAL, "flat": TABLE_GOAL}
    if item.kind == "fine physics":
        default = {row.name: row.value for row in before}
        goals = {where: default[f"{item.robot} {CLOTH} {where}"] for where in goals}
    keys = {"in the air": "air", "dragged": "drag", "flat": "flat"}
    rows = [_rtf(f"{prefix} {where}", samples[keys[where]], goal) for where, goal in goals.items()]
    for where in ("in the air", "flat"):
        ours, bare = samples[keys[where]], samples[f"{keys[where]} bare"]
        rows.append(_beside(f"{prefix} loop / bare, {where}", ours, bare))
    return rows


def _sight_rows(samples: dict[str, FloatArray]) -> list[BenchmarkRow]:
    """Whole percepts of one frame beside the goal, the plain way to the same numbers, and other descriptors'."""
    others = {
        "goal": np.full_like(samples["percept"], PERCEPT_GOAL_S),
        "one filter2D per orientation": samples["plain"],
        "HOW as published": samples["plain how"],
        **{f"with {name}": samples[name] for name in ("how", "word", "hog")},
    }
    return [_beside(f"percept / {name}", samples["percept"], other, "ms") for name, other in others.items()]


def _rtf(name: str, step_wall_s: FloatArray, baseline: float) -> BenchmarkRow:
    value = STEP_S / float(np.median(step_wall_s))
    return BenchmarkRow(name=name, value=value, unit=RTF, baseline=baseline, samples=len(step_wall_s))


def _beside(name: str, ours_s: FloatArray, theirs_s: FloatArray, unit: str = PER_STEP) -> BenchmarkRow:
    """The ratio is the median of those of neighbouring blocks, which a busy machine slows alike."""
    theirs = float(np.median(theirs_s))
    ratio = float(np.median(ours_s / theirs_s))
    return BenchmarkRow(name=name, value=1e3 * theirs * ratio, unit=unit, baseline=1e3 * theirs, samples=len(ours_s))


def _faster(name: str, ours_s: FloatArray, theirs_s: FloatArray) -> BenchmarkRow:
    """Simulated over wall time of both, from wall s per simulated s of neighbouring blocks."""
    theirs = 1 / float(np.median(theirs_s))
    ratio = float(np.median(theirs_s / ours_s))
    return BenchmarkRow(name=name, value=ratio * theirs, unit=RTF, baseline=theirs, samples=len(ours_s))


def _more_workers(samples: dict[str, FloatArray]) -> BenchmarkRow:
    """Episodes a minute of the most workers, beside those of one."""
    few, many = (60 / float(samples[str(workers)][0]) for workers in measure_batch.WORKERS)
    name = f"batch of {measure_batch.EPISODES}, {measure_batch.WORKERS[-1]} workers / 1"
    return BenchmarkRow(name=name, value=many, unit="episodes / min", baseline=few)


def _plain(name: str, walls_s: FloatArray, factor: float, unit: str) -> BenchmarkRow:
    return BenchmarkRow(name=name, value=factor * float(np.median(walls_s)), unit=unit, samples=len(walls_s))


def content(rows: list[BenchmarkRow]) -> dict[str, object]:
    """The JSON object without its schema number."""
    return {
        "rows": [
            {"name": row.name, "value": row.value, "unit": row.unit, "baseline": row.baseline, "ratio": row.ratio}
            for row in rows
        ],
        "samples": {row.name: row.samples for row in rows},
        "provenance": asdict(capture_provenance()),
    }


def show(rows: list[BenchmarkRow]) -> None:
    """Print the table on stdout."""
    table = Table()
    table.add_column("measurement")
    for name in ("value", "unit", "baseline", "ratio", "n"):
        table.add_column(name, justify="left" if name == "unit" else "right", no_wrap=True)
    for row in rows:
        beside = ["-" if number is None else f"{number:.3g}" for number in (row.baseline,)]
        ratio = "-" if row.ratio is None else f"{row.ratio:.2f}"
        table.add_row(row.name, f"{row.value:.3g}", row.unit, *beside, ratio, str(row.samples))
    console = Console()
    console.print(table)
    console.print(
        "Medians of n blocks or repeats, one core. Dragged and flat: on the table. Seen and recorded: with camera and "
        f"perception, and the episode kept. Baseline: what {CLOTH} is to reach, bare substeps of the same world, or "
        f"for {FINE_CLOTH} the value of {CLOTH} where it is not a goal of its own.",
        highlight=False,
    )
