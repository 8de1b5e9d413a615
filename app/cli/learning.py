"""Options of `layflat record`, `layflat train` and `layflat place`: teaching, and what was taught."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from layflat.app.cli.options import (
    Cloth,
    DataFile,
    Debug,
    Descriptor,
    Episodes,
    Force,
    Json,
    ModelFile,
    RobotChoice,
    Seed,
    Workers,
)
from layflat.app.support import validators

SourceName = Literal["scripted", "gamepad", "keyboard", "mouse", "kinesthetic"]
PolicyName = Literal["gp-word", "gp-baseline", "gp-contact", "gp-direction", "gp-finish", "gmr", "dmp", "nearest"]
Around = Annotated[
    list[str] | None,
    typer.Option("--with", metavar="recovery|steady", help="What is put around the policy; repeatable."),
]


def record(
    path: DataFile,
    workers: Workers,
    robot: Annotated[RobotChoice, typer.Option(help="What holds the cloth.")] = "hanger",
    cloth: Cloth = "towel",
    source: Annotated[SourceName, typer.Option(help="Who demonstrates.")] = "scripted",
    episodes: Episodes = 1,
    seed: Seed = 0,
    descriptor: Descriptor = "word-axial",
    images: Annotated[bool, typer.Option("--images/--no-images", help="Keep camera images, about 16 MB each.")] = False,
    disturb: Annotated[str, typer.Option(metavar="NAME", help="What the disturb button does to the cloth.")] = "push",
    window: Annotated[
        bool, typer.Option("--window/--no-window", help="Open the window where there is a display, or stay here.")
    ] = True,
    pad: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="A pad's mapping, by `layflat gamepad calibrate --file`.")
    ] = None,
    correct: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.npz", help="This model places; who moves the source takes over until they rest."),
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Record demonstrations.

    FILE.h5 is appended to if it exists, and each episode is durable once it is printed. With a person as the source it
    ends when --episodes are kept, or when the person quits; what was not to be kept is asked again.
    """
    validators.require_simulator()
    from layflat.app.commands.record import record as run
    from layflat.app.workers.record_config import RecordConfig

    run(
        RecordConfig(
            path=path,
            robot=robot,
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
        ),
        force=force,
        workers=workers,
    )


def train(
    data: DataFile,
    model: Annotated[Path, typer.Argument(metavar="MODEL.npz", show_default=False, help="The model to write.")],
    policy: Annotated[
        PolicyName, typer.Option(help="What to learn, and from which part of the cloth's state.")
    ] = "gp-word",
    intervention_weight: Annotated[
        int, typer.Option(min=1, metavar="W", help="How often each step counts in which a person corrected a policy.")
    ] = 1,
    seed: Seed = 0,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Learn a policy from demonstrations.

    Prints points, hyperparameters and held-out error.
    """
    from layflat.app.commands.train import train as run

    run(data, model, policy=policy, force=force, seed=seed, intervention_weight=intervention_weight)


def place(
    model: ModelFile,
    workers: Workers,
    episodes: Episodes = 1,
    seed: Seed = 0,
    disturb: Annotated[str | None, typer.Option(metavar="NAME", help="Disturb the cloth after the stop.")] = None,
    record: Annotated[Path | None, typer.Option(metavar="FILE.h5", help="Record the episodes there.")] = None,
    video: Annotated[Path | None, typer.Option(metavar="FILE.webm", help="Film the first episode.")] = None,
    json: Json = None,
    cloth: Annotated[str | None, typer.Option(help="Another cloth than the model was taught with.")] = None,
    around: Around = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Place a cloth with a trained model."""
    validators.require_simulator()
    from layflat.app.commands.place import place as run

    run(
        model,
        episodes=episodes,
        seed=seed,
        disturb=disturb,
        record=record,
        video=video,
        json=json,
        cloth=cloth,
        around=around or (),
        workers=workers,
        force=force,
    )
