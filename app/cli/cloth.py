"""Options of `layflat cloth`."""

from __future__ import annotations

from typing import Annotated

import typer

from layflat.app.cli.call import call
from layflat.app.cli.options import Debug, Force, Json, list_commands

cloth_cli = typer.Typer(name="cloth", help="List, check and fit cloths.", rich_markup_mode=None)
cloth_cli.callback(invoke_without_command=True)(list_commands)


@cloth_cli.command(name="list")
def list_(debug: Debug = False) -> None:
    """List the cloths that have a name."""
    from layflat.app.commands.cloth import list_cloths

    list_cloths()


@cloth_cli.command()
def check(
    file: Annotated[str, typer.Argument(metavar="FILE.toml", show_default=False, help="Cloth file, or a name.")],
    json: Json = None,
    debug: Debug = False,
) -> None:
    """Measure a cloth, and say what is wrong with it.

    Hanging stretch, bending length, sag, rest on the table and a fold.
    """
    call("commands.cloth:check", locals())


@cloth_cli.command()
def fit(
    file: Annotated[str, typer.Argument(metavar="FILE.toml", show_default=False, help="Cloth file.")],
    json: Json = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Find nodes, springs and rate of a cloth, and write them into its file.

    From its size, mass, hanging stretch and bending length.
    """
    call("commands.cloth:fit", locals())
