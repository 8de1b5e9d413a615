"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from layflat.app.support import validators

RobotChoice = Literal["hanger", "pickers"]
DescriptorName = Literal["word", "word-axial", "how", "hog"]


def count(param: typer.CallbackParam, value: int) -> int:
    """Callback of an option that must be at least 1."""
    return validators.positive(f"--{str(param.name).replace('_', '-')}", value)


def maybe_count(param: typer.CallbackParam, value: int | None) -> int | None:
    """The same where the option may be left out."""
    return None if value is None else count(param, value)


def seed_in_range(value: int) -> int:
    return validators.seed_in_range(value)


Episodes = Annotated[int, typer.Option(callback=count, help="How many; at least 1.", show_default=True)]
Seed = Annotated[int, typer.Option(callback=seed_in_range, help="Seed of everything that chance decides.")]
Cloth = Annotated[str, typer.Option(help="Which cloth: towel or napkin.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of a failure.")]
Workers = Annotated[
    int,
    typer.Option(
        callback=count,
        default_factory=validators.available_cores,
        show_default="one per core",
        help="Processes to share the episodes among; results do not depend on it.",
    ),
]
Json = Annotated[Path | None, typer.Option(metavar="FILE.json", help="Write the results there too.")]
Descriptor = Annotated[DescriptorName, typer.Option(help="Which descriptor gives the wrinkles' direction.")]
ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.npz", show_default=False, help="A trained model.")]
DataFile = Annotated[Path, typer.Argument(metavar="FILE.h5", show_default=False, help="Demonstrations.")]
