"""Options of `layflat record`, `layflat train` and `layflat place`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.options import (
    Cloth,
    DataFile,
    Debug,
    Descriptor,
    Episodes,
    Force,
    Json,
    Robot,
    Seed,
    Task,
    Workers,
)
from layflat.app.support import validators


def record(
    path: DataFile,
    workers: Workers,
    robot: Robot = "hanger",
    task: Task = "place",
    cloth: Cloth = "towel",
    source: Annotated[
        str, typer.Option(help="Who demonstrates: scripted, gamepad, keyboard, mouse or kinesthetic.")
    ] = "scripted",
    episodes: Episodes = 1,
    seed: Seed = 0,
    descriptor: Descriptor = "word-axial",
    images: Annotated[bool, typer.Option("--images/--no-images", help="Keep camera images, about 16 MB each.")] = False,
    disturb: Annotated[
        str, typer.Option("--disturb-button", metavar="NAME", help="Disturbance that the disturb button starts.")
    ] = "push",
    window: Annotated[
        bool, typer.Option("--window/--no-window", help="Open the live window where there is a display.")
    ] = True,
    pad: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Gamepad mapping from `layflat gamepad calibrate --file`.")
    ] = None,
    correct: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.npz", help="This model places; you take over by moving, until you rest."),
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Record demonstrations.

    Appends to FILE.h5 if it exists; an episode is durable when its line is printed. A person records until --episodes
    are kept or until they quit; an episode that is discarded is asked for again.
    """
    validators.require_simulator()
    from layflat.app.commands.record import record as run
    from layflat.app.workers.record_config import RecordConfig

    config = RecordConfig(
        path=path,
        robot=robot,
        task=task,
        cloth=cloth,
        source=source,
        episodes=episodes,
        seed=seed,
        descriptor=descriptor,
        images=images,
        disturb=disturb,
        window=window,
        mapping=pad,
        correct=correct,
    )
    run(config, force=force, workers=workers)


def train(
    data: DataFile,
    model: Annotated[Path, typer.Argument(metavar="MODEL.npz", show_default=False, help="Model to write.")],
    policy: Annotated[
        str,
        typer.Option(
            help="Policy to train: gp-word, gp-baseline, gp-contact, gp-direction, gp-finish, gmr, dmp or nearest."
        ),
    ] = "gp-word",
    intervention_weight: Annotated[
        int, typer.Option(min=1, metavar="W", help="Weight of steps in which a person corrected a policy.")
    ] = 1,
    seed: Seed = 0,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Train a policy from demonstrations.

    Prints points, hyperparameters and held-out error.
    """
    from layflat.app.commands.train import TrainConfig
    from layflat.app.commands.train import train as run

    config = TrainConfig(data=data, model=model, policy=policy, seed=seed, intervention_weight=intervention_weight)
    run(config, force=force)


def place(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="POLICY",
            show_default=False,
            help="Model file or built-in policy (scripted, hold, random, stretch-right, drag-rule); "
            "+recovery and +steady behind it.",
        ),
    ],
    workers: Workers,
    episodes: Episodes = 1,
    seed: Seed = 0,
    disturb: Annotated[
        str, typer.Option(metavar="NAME", help="Disturbance that starts when the policy has stopped.")
    ] = "none",
    record: Annotated[Path | None, typer.Option(metavar="FILE.h5", help="Record the episodes in this session.")] = None,
    video: Annotated[Path | None, typer.Option(metavar="FILE.webm", help="Video of the first episode.")] = None,
    json: Json = None,
    robot: Annotated[str | None, typer.Option(help="Robot of a built-in policy: hanger or pickers.")] = None,
    cloth: Annotated[
        str | None, typer.Option(help="Cloth; by default the one that the model was trained with.")
    ] = None,
    wrappers: Annotated[
        list[str] | None, typer.Option("--with", metavar="recovery|steady", help="Wrapper of the policy; repeatable.")
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Place a cloth with a policy."""
    validators.require_simulator()
    from layflat.app.commands.place import PlaceConfig
    from layflat.app.commands.place import place as run

    config = PlaceConfig(
        policy=policy,
        episodes=episodes,
        seed=seed,
        robot=robot,
        cloth=cloth,
        disturbance=disturb,
        wrappers=tuple(wrappers or ()),
        record=record,
        video=video,
        json=json,
    )
    run(config, workers=workers, force=force)
