"""Options of `layflat evaluate`, `disturb`, `demo`, `reproduce` and `bench`."""

from __future__ import annotations

from typing import Annotated

import typer

from layflat.app.cli.call import call
from layflat.app.cli.options import (
    CLOTHS,
    Cloth,
    Debug,
    Episodes,
    Folder,
    Force,
    Json,
    Physics,
    Seed,
    Settings,
    Task,
    Vary,
    Workers,
    count,
)
from layflat.app.support import validators
from layflat.app.support.seeds import EVALUATION_SEED

DEFAULT_SUITE = "thesis"
"""Suite of `layflat disturb` where none is given."""


def evaluate(
    context: typer.Context,
    policies: Annotated[
        list[str],
        typer.Argument(
            metavar="POLICY...",
            show_default=False,
            help="Model files or built-in policies (scripted, hold, random, stretch-right, drag-rule; of the task "
            "smooth: scripted, word, stretch-right, random). NAME=MODEL.npz names one; MODEL.npz+drag-rule repairs by "
            "a rule; +recovery and +steady are wrappers.",
        ),
    ],
    out: Folder,
    workers: Workers,
    episodes: Episodes = 20,
    seed: Seed = EVALUATION_SEED,
    disturb: Annotated[
        list[str] | None,
        typer.Option(
            "--disturb",
            "--suite",
            metavar="SUITE|NAME|FILE.toml",
            help="Also disturb by a suite (thesis, gentle, harsh, folds, wind), by a disturbance (push, pull, tug, "
            "poke, wind, gust-x, gust-y, lift-drop, lift-aside, fold-corner, fold-edge, thesis), or by a suite of your "
            "own; repeatable.",
        ),
    ] = None,
    cloths: Annotated[
        list[str] | None,
        typer.Option(
            "--cloth",
            show_default="those of the models",
            help=f"Cloth: {CLOTHS}; repeatable.",
        ),
    ] = None,
    robots: Annotated[
        list[str] | None,
        typer.Option(
            "--robot",
            show_default="those of the models",
            help="Robot of built-in policies: hanger, pickers or dual-arm; repeatable.",
        ),
    ] = None,
    task: Task = None,
    start: Annotated[
        str | None,
        typer.Option(
            show_default="that of the task",
            help="Start of the cloth: hanging, hanging-quick, crumpled, folded-corner or swinging.",
        ),
    ] = None,
    physics: Physics = None,
    settings: Settings = None,
    vary: Vary = None,
    limit_s: Annotated[
        float, typer.Option(metavar="S", help="Wall time after which an episode counts as hung.")
    ] = 900.0,
    engine: Annotated[
        str | None,
        typer.Option(show_default="local", help="Where the episodes run: local, or ray for a Ray cluster."),
    ] = None,
    address: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Address of the Ray cluster; by default a local one is started."),
    ] = None,
    videos: Annotated[
        bool | None,
        typer.Option(
            "--videos/--no-videos",
            show_default="some typical and worst episodes",
            help="Films of the best, the typical and the worst episode of each policy, or none.",
        ),
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Compare policies from the same starts, with the same disturbances.

    Writes rows, a summary, every episode and report.html to DIR. The same command continues after an interruption.
    """
    options = locals()
    if options.pop("context").info_name == "disturb":
        options["disturb"] = disturb or [DEFAULT_SUITE]
    call("commands.evaluate:evaluate", options)


def benchmark(
    policies: Annotated[
        list[str],
        typer.Argument(metavar="POLICY...", show_default=False, help="Policies, as in `layflat evaluate`."),
    ],
    out: Folder,
    workers: Workers,
    quick: Annotated[bool, typer.Option("--quick", help="A small part, in two to three minutes on two cores.")] = False,
    phrase: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            show_default="the published seeds",
            help="Held-out seeds, which follow from this text.",
        ),
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Score policies on Layflat Bench 1.

    Robots, cloths, disturbances and variations on published seeds, into DIR/benchmark.html and DIR/benchmark.json. The
    same command continues after an interruption.
    """
    call("commands.benchmark:run_benchmark", locals())


DISTURB_HELP = f"""Compare policies through suites of disturbances.

The same as `layflat evaluate --disturb SUITE`, with the suite {DEFAULT_SUITE} where none is given: every episode also
runs undisturbed, from the same placement.
"""


def demo(
    workers: Workers,
    out: Folder,
    episodes: Episodes = 5,
    seed: Seed = 0,
    robots: Annotated[
        list[str] | None,
        typer.Option(
            "--robot",
            show_default="hanger and pickers",
            help="Only this robot: hanger, pickers or dual-arm; repeatable.",
        ),
    ] = None,
    cloth: Cloth = None,
    physics: Physics = None,
    settings: Settings = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Run the whole story, into DIR/report.html.

    Headless: demonstrations, training, placing, disturbance, report.
    """
    call("commands.demo:run_demo", locals())


def reproduce(
    workers: Workers,
    out: Folder,
    quick: Annotated[bool, typer.Option("--quick", help="Everything with few starts, under 15 minutes.")] = False,
    seeds: Annotated[
        int | None, typer.Option(callback=count, help="Starts of each experiment; 20, or 2 with --quick.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Run only this experiment; repeatable.")
    ] = None,
    report_only: Annotated[bool, typer.Option("--report-only", help="Run nothing; only write the page.")] = False,
    seed: Seed = 0,
    debug: Debug = False,
) -> None:
    """Run every experiment of the thesis, our numbers beside its numbers.

    Into DIR/report.html and DIR/table.md; the same command continues an interrupted reproduction.
    """
    call("reproduce.run:reproduce", locals())


def bench(json: Json = None, force: Force = False, debug: Debug = False) -> None:
    """Measure how fast this machine simulates.

    Simulated over wall time in the air, on the table and with the camera.
    """
    validators.require_simulator()
    from layflat.app.benchmarks.bench import bench as run

    run(json, force=force)
