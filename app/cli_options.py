"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app import checks


def _count(param: typer.CallbackParam, value: int) -> int:
    return checks.at_least_one(f"--{param.name}", value)


def _seed(value: int) -> int:
    return checks.seed_in_range(value)


Episodes = Annotated[int, typer.Option(callback=_count, help="How many; at least 1.", show_default=True)]
Seed = Annotated[int, typer.Option(callback=_seed, help="Seed of everything that chance decides.")]
Cloth = Annotated[str, typer.Option(help="Which cloth: towel or napkin.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of a failure.")]
Workers = Annotated[
    int,
    typer.Option(
        callback=_count,
        default_factory=checks.available_cores,
        show_default="one per core",
        help="Processes to share the episodes among; results do not depend on it.",
    ),
]
Json = Annotated[Path | None, typer.Option(metavar="FILE.json", help="Write the results there too.")]
ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.npz", show_default=False, help="A trained model.")]
DataFile = Annotated[Path, typer.Argument(metavar="FILE.h5", show_default=False, help="Demonstrations.")]
