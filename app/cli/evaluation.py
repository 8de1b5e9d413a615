"""Options of `layflat evaluate` and `layflat disturb`; the work is in ``app/commands/evaluate.py``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.options import Debug, Episodes, Force, Seed, Task, Workers
from layflat.app.support import validators

Policies = Annotated[
    list[str],
    typer.Argument(
        metavar="POLICY...",
        show_default=False,
        help="Model files or built-in policies (scripted, hold, random, stretch-right, drag-rule). NAME=MODEL.npz "
        "names one; MODEL.npz+drag-rule repairs by a rule; +recovery and +steady are wrappers.",
    ),
]
Out = Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Folder for all results.")]
Cloths = Annotated[
    list[str] | None,
    typer.Option(show_default="those of the models", help="Cloth: towel, napkin or towel-fine; repeatable."),
]
Robots = Annotated[
    list[str] | None,
    typer.Option(show_default="those of the models", help="Robot of built-in policies: hanger or pickers; repeatable."),
]
StartAt = Annotated[str | None, typer.Option(help="Start of the cloth: hanging, crumpled, folded-corner or swinging.")]
Limit = Annotated[float, typer.Option(metavar="S", help="Wall time after which an episode counts as hung.")]
Engine = Annotated[str, typer.Option(help="Where the episodes run: local, or ray for a Ray cluster.")]
Address = Annotated[
    str | None, typer.Option(metavar="HOST:PORT", help="Address of the Ray cluster; by default a local one is started.")
]
Videos = Annotated[bool, typer.Option("--videos", help="Videos of the best, the median and the worst of each policy.")]
_SUITE = "a suite (thesis, gentle, harsh, folds, wind), the name of a disturbance, or a suite of your own; repeatable."
Disturbances = Annotated[
    list[str] | None, typer.Option("--disturb", metavar="SUITE|NAME|FILE.toml", help=f"Also disturb by {_SUITE}")
]
Suites = Annotated[list[str], typer.Option("--suite", metavar="SUITE|NAME|FILE.toml", help=f"Disturb by {_SUITE}")]


def evaluate(
    policies: Policies,
    out: Out,
    workers: Workers,
    episodes: Episodes = 20,
    seed: Seed = 0,
    disturb: Disturbances = None,
    cloth: Cloths = None,
    robot: Robots = None,
    task: Task = "place",
    start: StartAt = None,
    limit_s: Limit = 900.0,
    engine: Engine = "local",
    address: Address = None,
    videos: Videos = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Compare policies from the same starts, with the same disturbances.

    Writes rows, a summary, every episode and report.html to DIR. The same command continues after an interruption.
    """
    validators.require_simulator()
    from layflat.app.commands.evaluate import EvaluateConfig
    from layflat.app.commands.evaluate import evaluate as run

    config = EvaluateConfig(
        policies=tuple(policies),
        out=out,
        episodes=episodes,
        seed=seed,
        disturb=tuple(disturb or ()),
        cloths=tuple(cloth or ()),
        robots=tuple(robot or ()),
        task=task,
        start=start,
        limit_s=limit_s,
        engine=engine,
        address=address,
        videos=videos,
    )
    run(config, workers=workers, force=force)


def disturb(
    policies: Policies,
    out: Out,
    workers: Workers,
    suite: Suites = ["thesis"],  # noqa: B006 - typer's way to a default of an option that may be repeated
    episodes: Episodes = 20,
    seed: Seed = 0,
    cloth: Cloths = None,
    robot: Robots = None,
    task: Task = "place",
    start: StartAt = None,
    limit_s: Limit = 900.0,
    engine: Engine = "local",
    address: Address = None,
    videos: Videos = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Compare policies through suites of disturbances.

    The same as `layflat evaluate --disturb SUITE`: every episode also runs undisturbed, from the same placement.
    """
    evaluate(
        policies,
        out,
        workers,
        episodes=episodes,
        seed=seed,
        disturb=suite,
        cloth=cloth,
        robot=robot,
        task=task,
        start=start,
        limit_s=limit_s,
        engine=engine,
        address=address,
        videos=videos,
        force=force,
        debug=debug,
    )
