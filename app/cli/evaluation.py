"""Options of `layflat evaluate` and `layflat disturb`; the work is in ``app/commands/evaluate.py``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from layflat.app.cli.options import Debug, Episodes, Force, Seed, Workers
from layflat.app.support import validators

EngineName = Literal["local", "ray"]
StartName = Literal["hanging", "crumpled", "folded-corner", "swinging"]

Policies = Annotated[
    list[str],
    typer.Argument(
        metavar="MODEL.npz...",
        show_default=False,
        help="Trained models; NAME=MODEL.npz names one, MODEL.npz+drag-rule lets a rule repair, +recovery lifts what "
        "is folded, +steady waits for what swings. Or those that need no model: scripted, hold, random, stretch-right, "
        "drag-rule.",
    ),
]
Out = Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Folder for all results.")]
Cloths = Annotated[
    list[str] | None,
    typer.Option(show_default="those of the models", help="Which cloth: towel or napkin; may be given several times."),
]
Robots = Annotated[
    list[str] | None,
    typer.Option(show_default="those of the models", help="hanger or pickers; needed only without a model."),
]
StartAt = Annotated[StartName, typer.Option(help="How the cloth begins.")]
Limit = Annotated[float, typer.Option(metavar="S", help="Wall time after which an episode counts as hung.")]
Engine = Annotated[EngineName, typer.Option(help="On this machine, or on a Ray cluster.")]
Address = Annotated[
    str | None, typer.Option(metavar="HOST:PORT", help="Of the Ray cluster; a local one is started without.")
]
Videos = Annotated[bool, typer.Option("--videos", help="Film the best, the median and the worst of each policy.")]
_SUITE = (
    "a suite (thesis, gentle, harsh, folds, wind), a single disturbance by name, or a suite of your own; may be given "
    "several times."
)
Disturbances = Annotated[
    list[str] | None, typer.Option("--disturb", metavar="SUITE|NAME|FILE.toml", help=f"Also with {_SUITE}")
]
Suites = Annotated[
    list[str], typer.Option("--suite", metavar="SUITE|NAME|FILE.toml", help=f"What happens: {_SUITE}")
]  # fmt: skip


def evaluate(
    policies: Policies,
    out: Out,
    workers: Workers,
    episodes: Episodes = 20,
    seed: Seed = 0,
    disturb: Disturbances = None,
    cloth: Cloths = None,
    robot: Robots = None,
    start: StartAt = "hanging",
    limit_s: Limit = 900.0,
    engine: Engine = "local",
    address: Address = None,
    videos: Videos = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Compare policies from the same starts, through the same disturbances.

    Rows, summary, every episode and report.html into DIR; the same command goes on where it was interrupted.
    """
    validators.require_simulator()
    from layflat.app.commands.evaluate import evaluate as run

    run(
        policies,
        out=out,
        episodes=episodes,
        seed=seed,
        disturb=disturb or (),
        cloths=cloth or (),
        robots=robot or (),
        start=start,
        limit_s=limit_s,
        workers=workers,
        engine=engine,
        address=address,
        videos=videos,
        force=force,
    )


def disturb(
    policies: Policies,
    out: Out,
    workers: Workers,
    suite: Suites = ["thesis"],  # noqa: B006 - typer's way to a default of an option that may be repeated
    episodes: Episodes = 20,
    seed: Seed = 0,
    cloth: Cloths = None,
    robot: Robots = None,
    start: StartAt = "hanging",
    limit_s: Limit = 900.0,
    engine: Engine = "local",
    address: Address = None,
    videos: Videos = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """The same as `layflat evaluate --disturb SUITE`.

    Every episode also undisturbed, from the very same placing.
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
        start=start,
        limit_s=limit_s,
        engine=engine,
        address=address,
        videos=videos,
        force=force,
        debug=debug,
    )
