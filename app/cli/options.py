"""Options and arguments that several commands share; None stands for the default of the command's config."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from layflat.app.support import machine, validators


def list_commands(context: typer.Context) -> None:
    """Print the help of a group that is called without a command."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def expand_home(app: typer.Typer) -> None:
    """Have every command of ``app`` get its paths with a leading ``~`` expanded, which a shell does not behind =."""
    for command in app.registered_commands:
        if command.callback is not None:
            command.callback = _with_paths_expanded(command.callback)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            expand_home(group.typer_instance)


def _with_paths_expanded(command: Callable[..., Any]) -> Callable[..., Any]:
    def expanded(value: Any) -> Any:
        if isinstance(value, list):
            return [expanded(item) for item in value]
        return Path(os.path.expanduser(value)) if isinstance(value, Path) else value

    @functools.wraps(command)
    def run(**options: Any) -> Any:
        return command(**{name: expanded(value) for name, value in options.items()})

    return run


def count(param: typer.CallbackParam, value: int | None) -> int | None:
    """Check an option that must be at least 1 where it is given."""
    return None if value is None else validators.positive(f"--{str(param.name).replace('_', '-')}", value)


def seed_in_range(value: int | None) -> int | None:
    """Check a seed where it is given."""
    return None if value is None else validators.seed_in_range(value)


def episode_number(value: int | None) -> int | None:
    """Check the number of a demo where it is given."""
    return None if value is None else validators.episode_number(value)


Episodes = Annotated[int, typer.Option(callback=count, help="Number of episodes.")]
Seed = Annotated[int, typer.Option(callback=seed_in_range, help="Random seed.")]
Robot = Annotated[
    str | None, typer.Option(show_default="hanger", help="Robot that holds the cloth: hanger, pickers or dual-arm.")
]
Task = Annotated[
    str | None, typer.Option(show_default="place", help="Task: place, or smooth, which begins with a crumpled cloth.")
]
CLOTHS = (
    "towel, napkin, towel-fine, bandana, denim, dish-towel, hand-towel, handkerchief, linen, silk-scarf, terry or"
    " FILE.toml"
)
"""Every cloth that has a name (`layflat.sim.cloth.registry`), for help."""
Cloth = Annotated[str | None, typer.Option(show_default="towel", help=f"Cloth: {CLOTHS}.")]
Physics = Annotated[
    str | None,
    typer.Option(show_default="bullet", help="Physics engine: bullet, or mujoco (pip install 'layflat[mujoco]')."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set a condition; `layflat config` lists the keys; repeatable."),
]
Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME|FILE.toml",
        help="Draw conditions for each seed: cloths, camera, light, contact, all, or a file of your own; repeatable.",
    ),
]
Descriptor = Annotated[
    str | None,
    typer.Option(
        show_default="word-axial", help="Descriptor of the wrinkles' direction: word, word-axial, how or hog."
    ),
]
Station = Annotated[
    Path | None,
    typer.Option(metavar="FILE.toml", show_default=False, help="A real robot and camera; twin: their digital twin."),
]
Slow = Annotated[float, typer.Option(min=1.0, max=20.0, help="At a station: stretch every step by this factor.")]
Yes = Annotated[bool, typer.Option("--yes", help="At a station: do not ask before the first motion.")]
Force = Annotated[bool, typer.Option("--force", help="Replace existing files.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of a failure.")]
Workers = Annotated[
    int,
    typer.Option(
        callback=count,
        default_factory=machine.default_workers,
        show_default="one per core, as far as memory allows",
        help="Number of processes; results do not depend on it.",
    ),
]
Folder = Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Folder for all results.")]
Json = Annotated[Path | None, typer.Option(metavar="FILE.json", help="Also write the results to this file.")]
Video = Annotated[Path | None, typer.Option(metavar="FILE.webm", help="Video of the first episode.")]
DataFile = Annotated[Path, typer.Argument(metavar="FILE.h5", show_default=False, help="Session of demonstrations.")]
Episode = Annotated[
    int, typer.Option(callback=episode_number, metavar="K", show_default=False, help="Episode demo_K of the file.")
]
