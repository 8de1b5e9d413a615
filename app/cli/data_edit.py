"""Options of `layflat data edit FILE.h5 ...`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from layflat.app.cli.options import DataFile, Debug, Force, Json

Demo = Annotated[str, typer.Argument(metavar="demo_K", show_default=False, help="Episode, by name or number.")]
Demos = Annotated[list[str], typer.Argument(metavar="demo_K...", show_default=False, help="Episodes.")]

edit_cli = typer.Typer(
    name="edit",
    help="Relabel, trim, drop or annotate episodes; undo that.",
    rich_markup_mode=None,
)


@edit_cli.callback(invoke_without_command=True)
def edit(context: typer.Context, path: DataFile, debug: Debug = False) -> None:
    """Relabel, trim, drop, restore and annotate episodes; every edit can be undone.

    Edits are kept in FILE.h5.edits.jsonl and apply to everything that reads the session; the recording itself stays
    as it is. Without a command, prints the edits.
    """
    context.obj = path
    if context.invoked_subcommand is None:
        _run(context, "log", json=None, force=False)


@edit_cli.command()
def relabel(
    context: typer.Context,
    episode: Demo,
    outcome: Annotated[str, typer.Argument(metavar="success|failure|partial", show_default=False, help="New label.")],
    debug: Debug = False,
) -> None:
    """Label an episode success, failure or partial."""
    _run(context, "relabel", episode, outcome)


@edit_cli.command()
def trim(
    context: typer.Context,
    episode: Demo,
    start: Annotated[int, typer.Argument(metavar="FROM", show_default=False, help="First step to keep.")],
    stop: Annotated[int, typer.Argument(metavar="TO", show_default=False, help="Step after the last to keep.")],
    debug: Debug = False,
) -> None:
    """Keep the steps FROM to TO - 1 of an episode.

    Steps are counted as recorded, so that a later trim can keep more again.
    """
    _run(context, "trim", episode, start, stop)


@edit_cli.command()
def drop(context: typer.Context, episodes: Demos, debug: Debug = False) -> None:
    """Leave episodes out."""
    _run(context, "drop", episodes)


@edit_cli.command()
def restore(context: typer.Context, episodes: Demos, debug: Debug = False) -> None:
    """Take dropped episodes in again."""
    _run(context, "restore", episodes)


@edit_cli.command()
def note(
    context: typer.Context,
    episode: Demo,
    text: Annotated[str, typer.Argument(metavar="TEXT", show_default=False, help='Note; "" removes it.')],
    debug: Debug = False,
) -> None:
    """Write a note on an episode."""
    _run(context, "note", episode, text)


@edit_cli.command()
def undo(
    context: typer.Context,
    number: Annotated[
        int | None, typer.Argument(metavar="[N]", show_default=False, help="Number of the edit; the newest by default.")
    ] = None,
    debug: Debug = False,
) -> None:
    """Take back an edit; undoing an undo does it again."""
    _run(context, "undo", number)


@edit_cli.command()
def log(context: typer.Context, json: Json = None, force: Force = False, debug: Debug = False) -> None:
    """Print all edits: number, time, author, and which were undone."""
    _run(context, "log", json=json, force=force)


def _run(context: typer.Context, action: str, *values: Any, **options: Any) -> None:
    from layflat.app.commands import dataset_edit

    getattr(dataset_edit, action)(context.obj.expanduser(), *values, **options)
