"""The command line: options in, one call of a function of ``app``, exit status out. No logic here.

What is heavy is imported inside the commands, so that ``layflat --help`` answers at once and ``layflat doctor`` runs
where the rest cannot.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.data import data_cli, replay
from layflat.app.cli.evaluation import disturb, evaluate
from layflat.app.cli.gamepad import gamepad_cli
from layflat.app.cli.learning import place, record, train
from layflat.app.cli.options import (
    Cloth,
    Debug,
    Descriptor,
    Episodes,
    Force,
    Json,
    Seed,
    Workers,
    maybe_count,
)
from layflat.app.support import validators
from layflat.app.support.errors import INTERRUPTED, USAGE_ERROR, run_command

cli = typer.Typer(
    name="layflat",
    help="Teaches a simulated robot to lay cloth flat, and to repair what a disturbance undoes.",
    add_completion=False,
    rich_markup_mode=None,
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


def demo(
    workers: Workers,
    out: Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Folder for all results.")],
    episodes: Episodes = 5,
    seed: Seed = 0,
    robot: Annotated[str | None, typer.Option(help="Only this robot; both by default.")] = None,
    cloth: Cloth = "towel",
    force: Force = False,
    debug: Debug = False,
) -> None:
    """The whole story, into DIR/report.html.

    Headless: demonstrations, training, placing, disturbance, report.
    """
    validators.require_simulator()
    from layflat.app.commands.demo import run_demo

    robots: tuple[str, ...] = (robot,) if robot else ("hanger", "pickers")
    run_demo(out, episodes=episodes, seed=seed, robots=robots, cloth=cloth, workers=workers, force=force)


def app_(
    folder: Annotated[Path, typer.Option(metavar="DIR", help="Where sessions and models are, and go.")] = Path("runs"),
    debug: Debug = False,
) -> None:
    """Open the workstation's window.

    Record, train, place, disturb, replay and look after data from one place.
    """
    validators.require_simulator()
    from layflat.app.workstation.window.launch import app as run

    raise typer.Exit(run(folder))


def word(
    rgb: Annotated[Path, typer.Argument(metavar="RGB.png", show_default=False, help="The colour picture.")],
    depth: Annotated[Path, typer.Argument(metavar="DEPTH.png", show_default=False, help="Aligned depth, 16 bits.")],
    json: Json = None,
    overlay: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw what was seen there.")] = None,
    flat_pixels: Annotated[
        int | None, typer.Option(callback=maybe_count, metavar="N", help="Cloth pixels of the cloth laid flat.")
    ] = None,
    intrinsics: Annotated[
        str | None, typer.Option(metavar="FX,FY,CX,CY", help="Of the colour camera, px; a D435's by default.")
    ] = None,
    depth_scale: Annotated[float, typer.Option(metavar="MM", help="Millimetres of one unit of depth.")] = 1.0,
    hsv: Annotated[
        str | None, typer.Option(metavar="H_MIN,H_MAX,S_MIN,V_MIN", help="The cloth's colour: degrees, 0..1, 0..1.")
    ] = None,
    cloth_at: Annotated[str | None, typer.Option(metavar="X,Y", help="A pixel on the cloth: learn its colour.")] = None,
    contact_mm: Annotated[
        float | None, typer.Option(metavar="MM", help="Cloth no higher than this is in contact; 8 by default.")
    ] = None,
    descriptor: Descriptor = "word-axial",
    seed: Seed = 0,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """See the cloth in a real camera's frame.

    WORD and contact portion; x to the image's right, y up.
    """
    from layflat.app.commands.analyze_frame import analyze_frame_files as run

    run(
        rgb,
        depth,
        json=json,
        overlay=overlay,
        flat_pixels=flat_pixels,
        intrinsics=intrinsics,
        depth_scale=depth_scale,
        hsv=hsv,
        cloth_at=cloth_at,
        contact_mm=contact_mm,
        descriptor_name=descriptor,
        seed=seed,
        force=force,
    )


def flatten(
    workers: Workers,
    controller: Annotated[str, typer.Option(help="Controller of the pickers: word, stretch-right or random.")] = "word",
    descriptor: Descriptor = "word-axial",
    episodes: Episodes = 1,
    seed: Seed = 0,
    cloth: Cloth = "towel",
    video: Annotated[Path | None, typer.Option(metavar="FILE.webm", help="Film the first episode.")] = None,
    strip: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Ten frames of the first episode.")] = None,
    json: Json = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Pull the wrinkles out of a crumpled cloth.

    By Algorithm 2 of the thesis, or by one of the controllers that it is compared with.
    """
    validators.require_simulator()
    from layflat.app.commands.flatten import FlattenConfig
    from layflat.app.commands.flatten import flatten as run

    config = FlattenConfig(
        controller=controller,
        descriptor=descriptor,
        episodes=episodes,
        seed=seed,
        cloth=cloth,
        video=video,
        strip=strip,
        json=json,
    )
    run(config, workers=workers, force=force)


def reproduce(
    workers: Workers,
    out: Annotated[Path, typer.Option(metavar="DIR", show_default=False, help="Folder for all results.")],
    quick: Annotated[bool, typer.Option("--quick", help="Everything with few starts, under 15 minutes.")] = False,
    seeds: Annotated[
        int | None, typer.Option(callback=maybe_count, help="Starts of each experiment; 20, or 2 with --quick.")
    ] = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Run only this experiment; repeatable.")
    ] = None,
    report_only: Annotated[bool, typer.Option("--report-only", help="Run nothing, only write the page anew.")] = False,
    seed: Seed = 0,
    debug: Debug = False,
) -> None:
    """Every experiment of the thesis, ours beside its.

    Into DIR/report.html and DIR/table.md; the same command goes on where an earlier one stopped.
    """
    validators.require_simulator()
    from layflat.app.reproduce.run import reproduce as run

    run(out, quick=quick, seeds=seeds, seed=seed, only=only or [], workers=workers, report_only=report_only)


def bench(json: Json = None, force: Force = False, debug: Debug = False) -> None:
    """Measure how fast this machine simulates.

    Simulated over wall time in the air, on the table and with the camera.
    """
    validators.require_simulator()
    from layflat.app.benchmarks.bench import bench as run

    run(json, force=force)


def doctor(debug: Debug = False) -> None:
    """Check this machine, and say what to do.

    Interpreter, packages, films, memory, display, pad and cores.
    """
    from layflat.app.commands.doctor import doctor as run

    run()


# In the order of `layflat --help`.
cli.command()(demo)
cli.command()(record)
cli.command(name="app")(app_)
for _command in (train, place, word, flatten, reproduce, bench, doctor, evaluate, disturb, replay):
    cli.command()(_command)
cli.add_typer(data_cli)
cli.add_typer(gamepad_cli)


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
        print(f"layflat: {sentence.rstrip('.')}; `layflat --help` lists what there is", file=sys.stderr)
        return int(getattr(error, "exit_code", USAGE_ERROR))


if __name__ == "__main__":
    main()
