"""`layflat bench`: speed of the simulation, the perception, the models and the recording on this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from layflat.app.benchmarks import (
    measure,
    measure_batch,
    measure_data,
    measure_env,
    measure_perception,
    measure_solver_settings,
)
from layflat.app.benchmarks.rows import BenchmarkRow, Samples, comparison_row, real_time_row, wall_row
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.app.workers.process import process_pool
from layflat.app.workers.work_item import LIMIT_S
from layflat.data.provenance import capture_provenance
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.robots.registry import DEFAULT_ROBOT, THESIS_ROBOTS

CLOTH, FINE_CLOTH = DEFAULT_CLOTH, "towel-fine"
AIR_GOAL, TABLE_GOAL = 1.5, 1.0
"""Simulated over wall time that one core should reach with the default cloth."""
SEEING_GOALS = {CLOTH: 1.0, FINE_CLOTH: 0.7}
"""The same with camera, perception and recording."""
PERCEPT_GOAL_S = 0.004
"""Wall time of one frame on one core: masks, contact and word-axial."""
PLACES = {"in the air": "air", "dragged": "drag", "flat": "flat"}
"""Places of the cloth in the measurements of the physics -> their samples."""
FOOTNOTE = (
    "Medians of n blocks or repeats, one core. Dragged and flat: on the table. Seen and recorded: with camera and "
    f"perception, and the episode kept. Baseline: the goal of {CLOTH}, bare substeps of the same world, or for "
    f"{FINE_CLOTH} the value of {CLOTH} where it has no goal of its own."
)


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One measurement, in a fresh process."""

    title: str
    seconds: float
    """Expected wall time."""
    work: Callable[..., Samples]
    arguments: tuple[object, ...] = ()
    rows: Callable[[Samples, Mapping[str, float]], list[BenchmarkRow]]
    """Makes rows of the samples and of the values of the rows before, by name."""
    forks: bool = False
    """Whether the work starts processes itself."""

    def run(self) -> Samples:
        """Measure in a process of its own, or from here where the work starts its own processes."""
        if self.forks:
            return self.work(*self.arguments)
        with process_pool(1) as pool:
            samples: Samples = pool.schedule(self.work, args=self.arguments, timeout=LIMIT_S).result()
        return samples


def bench(json: Path | None, *, force: bool) -> list[BenchmarkRow]:
    """Measure everything, one process at a time; print a table, and write ``json`` if asked to."""
    if json is not None:
        validators.writable_file(json, force=force, suffix=".json")
    rows: list[BenchmarkRow] = []
    plan = list(measurements(json.parent if json is not None else None))
    with Progress({item.title: item.seconds for item in plan}) as progress:
        for item in plan:
            progress.phase(item.title)
            rows += item.rows(item.run(), {row.name: row.value for row in rows})
    if json is not None:
        write_json(json, content(rows))
    print_results(rows)
    return rows


def measurements(folder: Path | None) -> Iterator[Measurement]:
    """Yield the measurements in order; episodes are kept in ``folder``, so that its disk is timed, or a temporary one.

    The fine cloth comes after the default one, with which it is compared.
    """
    for cloth, physics_s, seeing_s, blocks in ((CLOTH, 10.0, 12.0, measure.BLOCKS), (FINE_CLOTH, 18.0, 20.0, 4)):
        for robot in THESIS_ROBOTS:
            yield Measurement(
                title=f"physics, {robot}, {cloth}",
                seconds=physics_s,
                work=measure.physics,
                arguments=(robot, cloth, blocks),
                rows=partial(physics_rows, robot, cloth),
            )
        for robot in THESIS_ROBOTS:
            yield Measurement(
                title=f"seeing, {robot}, {cloth}",
                seconds=seeing_s,
                work=measure.seeing,
                arguments=(robot, cloth, folder),
                rows=partial(seeing_rows, robot, cloth),
            )
    yield Measurement(title="perception", seconds=6.0, work=measure_perception.perception, rows=perception_rows)
    for robot in THESIS_ROBOTS:
        yield Measurement(
            title=f"prediction, {robot}",
            seconds=4.0,
            work=measure.prediction,
            arguments=(robot,),
            rows=partial(prediction_rows, robot),
        )
    for nodes in measure_solver_settings.NODES:
        yield Measurement(
            title=f"published cloths, {nodes} x {nodes}",
            seconds=25.0,
            work=measure_solver_settings.published_cloths,
            arguments=(nodes, CLOTH),
            rows=partial(measure_solver_settings.rows, nodes),
        )
    for title, seconds, work, rows in (
        ("recording", 20.0, measure_data.recording, measure_data.recording_rows),
        ("opening", 30.0, measure_data.opening, measure_data.opening_rows),
    ):
        yield Measurement(title=title, seconds=seconds, work=work, arguments=(folder,), rows=rows)
    yield Measurement(
        title="environment", seconds=15.0, work=measure_env.one, arguments=(CLOTH,), rows=measure_env.one_rows
    )
    yield Measurement(
        title="environments",
        seconds=10.0,
        work=measure_env.processes,
        arguments=(CLOTH,),
        rows=measure_env.process_rows,
        forks=True,
    )
    yield Measurement(
        title="evaluation",
        seconds=70.0,
        work=measure_batch.scaling,
        arguments=(DEFAULT_ROBOT, CLOTH, folder),
        rows=measure_batch.rows,
        forks=True,
    )


def physics_rows(robot: str, cloth: str, samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return simulated over wall time beside the goals, or the default cloth's, and the loop beside bare substeps."""
    goals = {"in the air": AIR_GOAL, "dragged": TABLE_GOAL, "flat": TABLE_GOAL}
    if cloth != CLOTH:
        goals = {place: before[f"{robot} {CLOTH} {place}"] for place in goals}
    rows = [real_time_row(f"{robot} {cloth} {place}", samples[PLACES[place]], goal) for place, goal in goals.items()]
    for place in ("in the air", "flat"):
        ours, bare = samples[PLACES[place]], samples[f"{PLACES[place]} bare"]
        rows.append(comparison_row(f"{robot} {cloth} loop / bare, {place}", ours, bare))
    return rows


def seeing_rows(robot: str, cloth: str, samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return simulated over wall time with camera and recording, and the wall time of their parts."""
    name, goal = f"{robot} {cloth}", SEEING_GOALS[cloth]
    return [
        real_time_row(f"{name} seen and recorded, flat", samples["flat"], goal),
        real_time_row(f"{name} seen and recorded, dragged", samples["drag"], goal),
        wall_row(f"{name} camera frame", samples["capture"]),
        wall_row(f"{name} perception", samples["perceive"]),
        wall_row(f"{name} keep of {measure.EPISODE_STEPS} steps", samples["keep"]),
    ]


def perception_rows(samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return the perception of a frame beside the goal, the reference implementation and other descriptors."""
    others = {
        "goal": np.full_like(samples["percept"], PERCEPT_GOAL_S),
        "one filter2D per orientation": samples["reference"],
        "HOW as published": samples["reference how"],
        **{f"with {name}": samples[name] for name in ("how", "word", "hog")},
    }
    return [comparison_row(f"percept / {name}", samples["percept"], other, "ms") for name, other in others.items()]


def prediction_rows(robot: str, samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return a prediction of our Gaussian process beside GPy's."""
    name = f"{robot} GP, {measure.GP_POINTS} points / GPy"
    return [comparison_row(name, samples["predict"], samples["GPy"], "ms")]


def content(rows: list[BenchmarkRow]) -> dict[str, object]:
    """Return the JSON object without its schema number."""
    keys = ("name", "value", "unit", "baseline", "ratio")
    return {
        "rows": [{key: getattr(row, key) for key in keys} for row in rows],
        "samples": {row.name: row.samples for row in rows},
        "provenance": vars(capture_provenance()),
    }


def print_results(rows: list[BenchmarkRow]) -> None:
    """Print the table."""
    lines = []
    for row in rows:
        baseline, ratio = (
            "-" if n is None else f"{n:{form}}" for n, form in ((row.baseline, ".3g"), (row.ratio, ".2f"))
        )
        lines.append((row.name, row.unit, f"{row.value:.3g}", baseline, ratio, str(row.samples)))
    print_table(("measurement", "unit", "value", "baseline", "ratio", "n"), lines, left=2)
    print(FOOTNOTE)
