"""The command line: options in, one call of a function of ``app``, exit status out. No logic here.

What is heavy is imported inside the commands, so that ``layflat --help`` answers at once and ``layflat doctor`` runs
where the rest cannot.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.call import call
from layflat.app.cli.cloth import cloth_cli
from layflat.app.cli.data import data_cli
from layflat.app.cli.evaluation import DISTURB_HELP, bench, benchmark, demo, evaluate, reproduce
from layflat.app.cli.gamepad import gamepad_cli
from layflat.app.cli.learning import flatten, place, record, replay, train
from layflat.app.cli.options import Debug, Descriptor, Force, Json, Physics, Seed, Settings, count, expand_home
from layflat.app.cli.policy import policy_cli
from layflat.app.cli.station import station_cli
from layflat.app.support import validators
from layflat.app.support.errors import INTERRUPTED, USAGE_ERROR, run_command

cli = typer.Typer(
    name="layflat",
    help="Teaches a simulated robot to lay cloth flat, and to repair what a disturbance undoes.",
    add_completion=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"layflat {version('layflat')}")
        raise typer.Exit


@cli.callback()
def _main(
    show_version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Teaches a simulated robot to lay cloth flat, and to repair what a disturbance undoes."""


def app_(
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Where sessions and models are, and go.")] = Path("runs"),
    host: Annotated[
        str, typer.Option(metavar="HOST", help="Address to serve at; another one than 127.0.0.1 needs a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="PORT", help="Port; 0 takes a free one.")] = 8080,
    no_open: Annotated[bool, typer.Option("--no-open", help="Open no browser.")] = False,
    physics: Physics = None,
    settings: Settings = None,
    debug: Debug = False,
) -> None:
    """Serve the workstation to a browser.

    Record, train, place, disturb, replay, evaluate and look after data from one place. Prints its address.
    """
    validators.require_simulator()
    from layflat.app.workstation.web.server import AppConfig
    from layflat.app.workstation.web.server import app as run

    conditions = [*(settings or ()), *([f"physics={physics}"] if physics else [])]
    commands = typer.main.get_command(data_cli).commands  # type: ignore[attr-defined]
    config = AppConfig(
        folder=folder, host=host, port=port, open_browser=not no_open, settings=tuple(conditions), debug=debug,
        commands=commands,
    )  # fmt: skip
    raise typer.Exit(run(config))


def word(
    rgb: Annotated[Path, typer.Argument(metavar="RGB.png", show_default=False, help="The colour picture, or .jpg.")],
    depth: Annotated[
        Path, typer.Argument(metavar="DEPTH.png", show_default=False, help="Aligned depth, or .tiff with floats.")
    ],
    json: Json = None,
    overlay: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw what was seen there, also if refused.")
    ] = None,
    flat_pixels: Annotated[
        int | None, typer.Option(callback=count, metavar="N", help="Cloth pixels of the cloth laid flat.")
    ] = None,
    intrinsics: Annotated[
        str | None, typer.Option(metavar="FX,FY,CX,CY", help="Of the colour camera, px; a D435's by default.")
    ] = None,
    depth_scale: Annotated[
        float | None, typer.Option(metavar="MM", help="Millimetres of one unit of depth: 1, of floats 1000.")
    ] = None,
    hsv: Annotated[
        str | None, typer.Option(metavar="H_MIN,H_MAX,S_MIN,V_MIN", help="The cloth's colour: degrees, 0..1, 0..1.")
    ] = None,
    cloth_at: Annotated[str | None, typer.Option(metavar="X,Y", help="A pixel on the cloth.")] = None,
    mask: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Not black where the cloth is.")] = None,
    contact_mm: Annotated[
        float | None, typer.Option(metavar="MM", help="Cloth no higher than this is in contact; 8 by default.")
    ] = None,
    regions: Annotated[bool, typer.Option("--regions", help="Also the direction of each part of the cloth.")] = False,
    descriptor: Descriptor = None,
    seed: Seed = 0,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """See the cloth in a real camera's frame.

    WORD and contact portion; x to the image's right, y up.
    """
    call("commands.analyze_frame:analyze_frame_files", locals(), simulator=False)


def config(json: Json = None, force: Force = False, debug: Debug = False) -> None:
    """List the keys that --set takes.

    Type, unit, default, limits and meaning of each.
    """
    from layflat.app.commands.config import list_keys

    list_keys(json, force=force)


def doctor(debug: Debug = False) -> None:
    """Check this machine, and say what to do.

    Interpreter, packages, videos, memory, display, gamepad and cores.
    """
    from layflat.app.commands.doctor import doctor as run

    run()


# In the order of `layflat --help`.
cli.command()(demo)
cli.command()(record)
cli.command(name="app")(app_)
for _command in (train, place, word, flatten, reproduce, bench, config, doctor, evaluate, benchmark):
    cli.command()(_command)
cli.command(name="disturb", help=DISTURB_HELP)(evaluate)
cli.command()(replay)
cli.add_typer(data_cli)
cli.add_typer(gamepad_cli)
cli.add_typer(policy_cli)
cli.add_typer(cloth_cli)
cli.add_typer(station_cli)
expand_home(cli)


def main(argv: Sequence[str] | None = None) -> None:
    """Entry point of the ``layflat`` command."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    # One episode is one core's work: libraries that make threads of their own only get in each other's way. They look
    # once, when they are imported.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    status = run_command(lambda: _dispatch(arguments), debug="--debug" in arguments)
    if argv is None and status == INTERRUPTED:
        # Where Ctrl-C struck inside exec(), as in many imports, CPython would end by a signal instead of a status.
        with contextlib.suppress(KeyboardInterrupt):
            atexit._run_exitfuncs()  # Folders for sockets are removed here.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _dispatch(arguments: list[str]) -> int:
    """Run the command and return its status; a call that typer refuses is one sentence."""
    try:
        return int(cli(arguments or ["--help"], prog_name="layflat", standalone_mode=False) or 0)
    except typer.TyperException as error:
        sentence = " ".join(error.format_message().split()).replace("Value error, ", "")
        command = getattr(getattr(error, "ctx", None), "command_path", "layflat")
        print(f"layflat: {sentence.rstrip('.')}; `{command} --help` lists what there is", file=sys.stderr)
        return int(getattr(error, "exit_code", USAGE_ERROR))


if __name__ == "__main__":
    main()
