"""Options of `layflat gamepad`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.options import Debug, Force, list_commands

gamepad_cli = typer.Typer(name="gamepad", help="Show a gamepad's inputs and map its buttons.", rich_markup_mode=None)
gamepad_cli.callback(invoke_without_command=True)(list_commands)


@gamepad_cli.command()
def monitor(
    file: Annotated[Path | None, typer.Option("--file", metavar="FILE.json", help="Use this mapping.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="Stop after this time; by default at Ctrl-C.")] = None,
    debug: Debug = False,
) -> None:
    """Show the inputs of a gamepad.

    Sticks outside their dead zone, triggers and buttons; one line per change where stdout is not a terminal.
    """
    from layflat.app.commands.gamepad import monitor as run

    run(file, seconds)


@gamepad_cli.command()
def calibrate(
    file: Annotated[
        Path | None, typer.Option("--file", metavar="FILE.json", help="File to write, instead of your settings.")
    ] = None,
    sticks: Annotated[
        bool, typer.Option("--sticks", help="Only learn where worn sticks rest; their mapping stays.")
    ] = False,
    dead_zone: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=0.9, metavar="SHARE", help="Only set the share of a stick's way that counts as rest."
        ),
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Map the inputs of a gamepad, step by step.

    For a gamepad that SDL does not know or maps wrongly, or whose sticks are worn; recording then uses the mapping.
    """
    from layflat.app.commands.gamepad import calibrate as run

    run(file, force, sticks=sticks, dead_zone=dead_zone)
