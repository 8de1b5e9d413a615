"""Options of `layflat station`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from layflat.app.cli.call import call
from layflat.app.cli.options import Cloth, Debug, Episodes, Folder, Force, Seed, list_commands
from layflat.app.support.errors import UsageError
from layflat.app.support.seeds import EVALUATION_SEED

station_cli = typer.Typer(
    name="station", help="Check and calibrate a real robot and camera, or run their twin.", rich_markup_mode=None
)
station_cli.callback(invoke_without_command=True)(list_commands)
StationFile = Annotated[Path, typer.Argument(metavar="STATION.toml", show_default=False, help="The station's file.")]


@station_cli.command()
def check(
    station: StationFile,
    out: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Also write a page.")] = None,
    steps: Annotated[int, typer.Option(min=20, max=10_000, help="Control steps that are measured.")] = 100,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Measure jitter, delay, rates and noise with the arm at rest, and say whether the station is ready.

    `twin` in place of a file checks the digital twin.
    """
    raise typer.Exit(call("commands.station:check", locals()))


@station_cli.command()
def calibrate(
    kind: Annotated[str, typer.Argument(metavar="table|camera|cloth", show_default=False, help="What to measure.")],
    station: StationFile,
    poses: Annotated[int, typer.Option(min=5, max=100, help="Poses of the board, for camera.")] = 12,
    at: Annotated[
        str | None, typer.Option(metavar="COLUMN,ROW", help="A pixel of the cloth, for cloth; by default the centre.")
    ] = None,
    debug: Debug = False,
) -> None:
    """Measure the table's plane, the camera's pose (ChArUco board in the hand), or the cloth laid flat by hand.

    The result is written into STATION.toml.
    """
    options = {**locals(), "at": _pixel(at)}
    call("commands.station_calibrate:calibrate", options, simulator=False)


def _pixel(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        column, row = (int(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--at is {text!r}; it must be COLUMN,ROW, such as 320,240") from None
    return column, row


@station_cli.command()
def twin(
    out: Folder,
    policy: Annotated[
        str | None,
        typer.Option(metavar="POLICY", show_default="gp-finish, taught on the twin", help="As in `layflat place`."),
    ] = None,
    episodes: Episodes = 3,
    seed: Seed = EVALUATION_SEED,
    cloth: Cloth = None,
    disturb: Annotated[
        list[str] | None, typer.Option(metavar="NAME", show_default="thesis", help="As in `layflat evaluate`.")
    ] = None,
    force: Force = False,
    debug: Debug = False,
) -> None:
    """Run the digital twin end to end: teach, place, disturb, repair.

    The arm speaks the robot's own network protocol on this machine, the camera's frames go through the camera's own
    library, and the simulated cloth follows the pose that the arm reports. It runs at the pace of a clock.
    """
    call("commands.station:twin", locals())
