"""Options of `layflat gamepad`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.options import Debug, Force

gamepad_cli = typer.Typer(
    name="gamepad", help="Show a pad and map its buttons.", no_args_is_help=False, rich_markup_mode=None
)


@gamepad_cli.command()
def monitor(
    file: Annotated[Path | None, typer.Option("--file", metavar="FILE.json", help="Read it by this mapping.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="Stop after so long; at Ctrl-C by default.")] = None,
    debug: Debug = False,
) -> None:
    """Show what a pad says.

    Sticks behind their dead zone, triggers and buttons; a line for each change where stdout is no terminal.
    """
    from layflat.app.commands.gamepad import monitor as run

    run(file, seconds)


@gamepad_cli.command()
def calibrate(
    file: Annotated[
        Path | None, typer.Option("--file", metavar="FILE.json", help="Write it there instead of your settings.")
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Map a pad, step by step.

    For one that SDL does not know, or has wrong; recording then uses the mapping.
    """
    from layflat.app.commands.gamepad import calibrate as run

    run(file, force)
