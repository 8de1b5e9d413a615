"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from layflat.app.support import validators


def count(param: typer.CallbackParam, value: int) -> int:
    """Callback of an option that must be at least 1."""
    return validators.positive(f"--{str(param.name).replace('_', '-')}", value)


def maybe_count(param: typer.CallbackParam, value: int | None) -> int | None:
    """The same where the option may be left out."""
    return None if value is None else count(param, value)


def seed_in_range(value: int) -> int:
    return validators.seed_in_range(value)


Episodes = Annotated[int, typer.Option(callback=count, help="Number of episodes.", show_default=True)]
Seed = Annotated[int, typer.Option(callback=seed_in_range, help="Random seed.")]
Robot = Annotated[str, typer.Option(help="Robot that holds the cloth: hanger or pickers.")]
Task = Annotated[str, typer.Option(help="Task: place, or smooth from a crumpled start.")]
Cloth = Annotated[str, typer.Option(help="Cloth: towel, napkin or towel-fine.")]
Force = Annotated[bool, typer.Option("--force", help="Replace existing files.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of a failure.")]
Workers = Annotated[
    int,
    typer.Option(
        callback=count,
        default_factory=validators.available_cores,
        show_default="one per core",
        help="Number of processes; results do not depend on it.",
    ),
]
Json = Annotated[Path | None, typer.Option(metavar="FILE.json", help="Also write the results to this file.")]
Descriptor = Annotated[str, typer.Option(help="Descriptor of the wrinkles' direction: word, word-axial, how or hog.")]
ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.npz", show_default=False, help="A trained model.")]
DataFile = Annotated[Path, typer.Argument(metavar="FILE.h5", show_default=False, help="Demonstrations.")]
