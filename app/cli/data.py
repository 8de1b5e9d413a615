"""Options of `layflat data ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from layflat.app.cli.options import DataFile, Debug, Episode, Force, Json, Seed, count, episode_number, list_commands
from layflat.app.support import validators

FormatName = Literal["robomimic", "lerobot", "csv", "minari", "rrd"]
EditAction = Literal["relabel", "trim", "drop", "restore", "note", "undo", "log"]
OutcomeName = Literal["success", "failure", "partial"]


Session = Annotated[Path, typer.Option("--out", metavar="FILE.h5", show_default=False, help="Output session.")]
Outcome = Annotated[OutcomeName | None, typer.Option(help="Only episodes with this outcome.")]

data_cli = typer.Typer(
    name="data",
    help="Look at, check, change and convert recorded sessions.",
    rich_markup_mode=None,
)
data_cli.callback(invoke_without_command=True)(list_commands)


@data_cli.command()
def info(path: DataFile, json: Json = None, force: Force = False, debug: Debug = False) -> None:
    """Print a page about a session.

    Episodes, success, lengths, sources, contact at start and end.
    """
    from layflat.app.commands.dataset_info import info as run

    run(path, json=json, force=force)


@data_cli.command()
def validate(path: DataFile, json: Json = None, force: Force = False, debug: Debug = False) -> None:
    """Check everything in a session.

    Prints each violation with its path in the file; exit status 2 if there is one.
    """
    from layflat.app.commands.dataset_info import validate as run

    run(path, json=json, force=force)


@data_cli.command()
def stats(path: DataFile, json: Json = None, force: Force = False, debug: Debug = False) -> None:
    """Print minimum, maximum, mean and deviation of every column."""
    from layflat.app.commands.dataset_info import stats as run

    run(path, json=json, force=force)


@data_cli.command()
def split(
    path: DataFile,
    out: Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Output folder.")],
    share: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=SHARE", help="A part and its share; give one for each. Default: train and valid."),
    ] = None,
    seed: Seed = 0,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Deal the episodes out at random, into DIR/NAME.h5 each.

    Without --share these are train=0.8 and valid=0.2.
    """
    from layflat.app.commands.dataset_operations import split as run

    run(path, out, shares=share or ["train=0.8", "valid=0.2"], seed=seed, force=force)


@data_cli.command(name="filter")
def filter_(
    path: DataFile,
    out: Session,
    outcome: Outcome = None,
    source: Annotated[str | None, typer.Option(help="Only episodes from this source, such as scripted.")] = None,
    cloth: Annotated[str | None, typer.Option(help="Only episodes with this cloth.")] = None,
    min_steps: Annotated[int | None, typer.Option(callback=count, help="Smallest number of steps.")] = None,
    max_steps: Annotated[int | None, typer.Option(callback=count, help="Largest number of steps.")] = None,
    min_contact: Annotated[float | None, typer.Option(help="Smallest final contact portion, 0..1.")] = None,
    max_contact: Annotated[float | None, typer.Option(help="Largest final contact portion, 0..1.")] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Copy the episodes that meet every given condition."""
    from layflat.app.commands.dataset_operations import filter_episodes as run

    run(
        path,
        out,
        outcome=outcome,
        source=source,
        cloth=cloth,
        n_steps=(min_steps, max_steps),
        contact=(min_contact, max_contact),
        force=force,
    )


@data_cli.command()
def merge(
    paths: Annotated[list[Path], typer.Argument(metavar="FILE.h5...", show_default=False, help="Sessions.")],
    out: Session,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Merge several sessions into one.

    They must agree in robot, task, cloth and step; an episode that is in two of them is taken once.
    """
    from layflat.app.commands.dataset_operations import merge as run

    run(paths, out, force=force)


@data_cli.command()
def trim(
    path: DataFile,
    episode: Episode,
    out: Session,
    start: Annotated[int, typer.Option(help="First step to keep.")] = 0,
    stop: Annotated[int | None, typer.Option(help="Step after the last to keep; the end by default.")] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Cut an episode to some of its steps.

    All other episodes stay as they are.
    """
    from layflat.app.commands.dataset_operations import trim as run

    run(path, out, episode=episode, start=start, stop=stop, force=force)


@data_cli.command()
def repair(
    path: DataFile,
    out: Annotated[Path | None, typer.Option(metavar="FILE.h5", help="Output file; in place by default.")] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Save the intact episodes of a damaged file or a killed recording.

    A damaged file stays as FILE.h5.damaged. Exit status 1 if something was lost.
    """
    from layflat.app.commands.dataset_operations import repair as run

    run(path, out, force=force)


@data_cli.command()
def export(
    paths: Annotated[
        list[Path], typer.Argument(metavar="FILE.h5...", show_default=False, help="Session; lerobot takes several.")
    ],
    out: Annotated[Path, typer.Option(metavar="PATH", show_default=False, help="File (robomimic) or folder.")],
    form: Annotated[FormatName, typer.Option("--format", help="Output format.")] = "robomimic",
    outcome: Outcome = None,
    trim_idle: Annotated[
        bool, typer.Option("--trim-idle", help="Keep one step of the end in which the robot stands still.")
    ] = False,
    valid_share: Annotated[float, typer.Option(help="robomimic: share of episodes for validation.")] = 0.1,
    images: Annotated[
        bool, typer.Option("--images/--no-images", help="With camera images (lerobot, minari, rrd).")
    ] = True,
    depth: Annotated[
        bool, typer.Option("--depth", help="lerobot: with depth images too, at which ACT and Diffusion fail.")
    ] = False,
    task_text: Annotated[
        list[str] | None,
        typer.Option(metavar="TEXT", help="lerobot: task in words; once for all sessions, or one for each."),
    ] = None,
    data_license: Annotated[
        str, typer.Option("--license", metavar="ID", help="lerobot: licence of the data, such as cc-by-4.0.")
    ] = "unknown",
    seed: Seed = 0,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Convert a session for other tools.

    robomimic: an exact copy with the filter keys train and valid; lerobot: a LeRobot v3.0 data set; csv: two tables;
    minari: a Minari data set; rrd: a Rerun recording for each episode.
    """
    from layflat.app.commands.dataset import ExportOptions
    from layflat.app.commands.dataset import export as run

    options = ExportOptions(
        form=form,
        outcome=outcome,
        trim_idle=trim_idle,
        valid_share=valid_share,
        seed=seed,
        images=images,
        depth=depth,
        task_texts=task_text or (),
        data_license=data_license,
    )
    run(paths, out, options, force=force)


@data_cli.command(name="import")
def import_(
    path: Annotated[Path, typer.Argument(metavar="FILE.hdf5", show_default=False, help="A robomimic data set.")],
    out: Session,
    cloth: Annotated[str | None, typer.Option(help="Name of the cloth, if the file has none.")] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Convert a robomimic data set in our layout to a session."""
    from layflat.app.commands.dataset import import_file as run

    run(path, out, cloth=cloth, force=force)


@data_cli.command()
def video(
    path: DataFile,
    episode: Episode,
    out: Annotated[Path, typer.Option(metavar="FILE.webm", show_default=False, help="Output file.")],
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Write an episode as a video.

    It shows what the camera saw, with contact and WORD; without recorded images, the cloth's nodes are rendered.
    """
    validators.require_simulator()
    from layflat.app.commands.dataset import video as run

    run(path, out, episode=episode, force=force)


@data_cli.command()
def plot(
    path: DataFile,
    out: Annotated[Path, typer.Option(metavar="FILE.png", show_default=False, help="Output file.")],
    episode: Annotated[
        int | None, typer.Option(callback=episode_number, metavar="K", help="Only demo_K of the file.")
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Plot a session as an image.

    Paths, starts, actions, contact portion and WORD.
    """
    from layflat.app.commands.dataset import plot as run

    run(path, out, episode=episode, force=force)


@data_cli.command()
def edit(
    path: DataFile,
    action: Annotated[EditAction, typer.Argument(help="Edit, or log.")] = "log",
    values: Annotated[
        list[str] | None, typer.Argument(metavar="[VALUE]...", show_default=False, help="Episode and values.")
    ] = None,
    json: Json = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Relabel, trim, drop, restore or annotate episodes, or undo that.

    relabel demo_K success|failure|partial; trim demo_K FROM TO (keeps the steps FROM to TO - 1, as recorded); drop and
    restore demo_K...; note demo_K TEXT; undo [N] (the newest edit, or edit N; undoing an undo does it again); log.

    Edits are kept in FILE.h5.edits.jsonl and apply to all that reads the session; the recording stays as it is.
    """
    from layflat.app.commands.dataset_edit import edit as run

    run(path, action, values or [], json=json, force=force)
