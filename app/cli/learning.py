"""Options of `layflat record`, `train`, `place` and `flatten`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.call import call
from layflat.app.cli.options import (
    CLOTHS,
    Cloth,
    DataFile,
    Debug,
    Descriptor,
    Episode,
    Episodes,
    Force,
    Json,
    Physics,
    Robot,
    Seed,
    Settings,
    Slow,
    Station,
    Task,
    Vary,
    Video,
    Workers,
    Yes,
    seed_in_range,
)
from layflat.app.support.seeds import EVALUATION_SEED


def record(
    path: DataFile,
    workers: Workers,
    robot: Robot = None,
    task: Task = None,
    cloth: Cloth = None,
    source: Annotated[
        str | None,
        typer.Option(
            show_default="scripted", help="Who demonstrates: scripted, gamepad, keyboard, mouse or kinesthetic."
        ),
    ] = None,
    episodes: Episodes = 1,
    seed: Annotated[
        int | None,
        typer.Option(
            callback=seed_in_range,
            show_default="the next that FILE.h5 does not hold",
            help="First random seed; seeds that FILE.h5 holds are left out.",
        ),
    ] = None,
    physics: Physics = None,
    settings: Settings = None,
    vary: Vary = None,
    descriptor: Descriptor = None,
    images: Annotated[bool, typer.Option("--images/--no-images", help="Keep camera images, about 16 MB each.")] = False,
    disturb: Annotated[
        str | None,
        typer.Option(
            "--disturb-button",
            metavar="NAME",
            show_default="push",
            help="Disturbance that the disturb button starts, as in `layflat place --disturb`.",
        ),
    ] = None,
    window: Annotated[
        bool | None,
        typer.Option("--window/--no-window", show_default=False, help="Open the live window; by default if it can be."),
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option("--pad", metavar="FILE.json", help="Gamepad mapping from `layflat gamepad calibrate --file`."),
    ] = None,
    correct: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.npz", help="This model places; you take over by moving, until you rest."),
    ] = None,
    station: Station = None,
    slow: Slow = 1.0,
    yes: Yes = False,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Record demonstrations.

    Appends to FILE.h5 if it exists, and continues with the seeds after those that it holds; an episode is durable when
    its line is printed. A person records until --episodes are kept or until they quit; an episode that is discarded is
    asked for again.
    """
    call("commands.record:record", locals())


def train(
    data: DataFile,
    model: Annotated[Path, typer.Argument(metavar="MODEL.npz", show_default=False, help="Model to write.")],
    policy: Annotated[
        str | None,
        typer.Option(
            show_default="gp-word",
            help="Policy to train: gp-word, gp-baseline, gp-contact, gp-direction, gp-finish, gmr, dmp or nearest.",
        ),
    ] = None,
    intervention_weight: Annotated[
        int, typer.Option(min=1, metavar="W", help="Weight of steps in which a person corrected a policy.")
    ] = 1,
    also: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE.h5", help="Further session, also of another cloth; repeatable."),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(
            show_default="cloth",
            help="Coordinates: cloth, in which the model lays cloths of any size, or world, as in the thesis.",
        ),
    ] = None,
    seed: Seed = 0,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Train a policy from demonstrations.

    Prints points, hyperparameters and held-out error.
    """
    call("commands.train:train", locals(), simulator=False)


def place(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="POLICY",
            show_default=False,
            help="Model file or built-in policy (scripted, hold, random, stretch-right, drag-rule); MODEL.npz+drag-rule"
            " repairs by a rule; +recovery and +steady are wrappers.",
        ),
    ],
    workers: Workers,
    episodes: Episodes = 1,
    seed: Seed = EVALUATION_SEED,
    disturbance: Annotated[
        str | None,
        typer.Option(
            "--disturb",
            metavar="NAME",
            show_default="none",
            help="Disturbance that starts when the policy has stopped: none, push, pull, tug, poke, wind, gust-x, "
            "gust-y, lift-drop, lift-aside, fold-corner, fold-edge or thesis.",
        ),
    ] = None,
    record: Annotated[Path | None, typer.Option(metavar="FILE.h5", help="Record the episodes in this session.")] = None,
    video: Video = None,
    json: Json = None,
    robot: Annotated[
        str | None,
        typer.Option(show_default="that of the model", help="Robot of a built-in policy: hanger, pickers or dual-arm."),
    ] = None,
    cloth: Annotated[
        str | None,
        typer.Option(show_default="that of the model", help=f"Cloth: {CLOTHS}."),
    ] = None,
    wrappers: Annotated[
        list[str] | None, typer.Option("--with", metavar="recovery|steady", help="Wrapper of the policy; repeatable.")
    ] = None,
    station: Station = None,
    slow: Slow = 1.0,
    yes: Yes = False,
    physics: Physics = None,
    settings: Settings = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Place a cloth with a policy, in simulation or at a station."""
    call("commands.place:place", locals())


def flatten(
    workers: Workers,
    controller: Annotated[
        str | None,
        typer.Option(show_default="word", help="Controller of the pickers: word, stretch-right or random."),
    ] = None,
    descriptor: Descriptor = None,
    episodes: Episodes = 1,
    seed: Seed = 0,
    cloth: Cloth = None,
    physics: Physics = None,
    settings: Settings = None,
    video: Video = None,
    strip: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Ten frames of the first episode.")] = None,
    json: Json = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Pull the wrinkles out of a crumpled cloth.

    By Algorithm 2 of the thesis, or by one of the controllers that it is compared with.
    """
    call("commands.flatten:flatten", locals())


def replay(
    path: DataFile,
    episode: Episode,
    mode: Annotated[
        str | None,
        typer.Option(show_default="state", help="state: the recording; action: its actions, run again."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Run the actions under another condition; repeatable."),
    ] = None,
    json: Json = None,
    video: Annotated[Path | None, typer.Option(metavar="FILE.webm", help="Video of the replay.")] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Replay a recorded episode.

    state shows the recording; action runs the actions again from the same start and reports how far that diverges.
    """
    call("commands.replay:replay", locals())
