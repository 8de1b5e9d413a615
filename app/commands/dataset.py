"""`layflat data export|import|video|plot`: conversion of recorded episodes for other tools and people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, TypeAlias

from layflat.app.media.episode_plots import curves_of, plot_session
from layflat.app.media.episode_renderer import EpisodeRenderer, check_drawable
from layflat.app.media.video import write_episode_video
from layflat.app.support import validators
from layflat.app.support.errors import UsageError, say
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import copies_text
from layflat.data.exchange.robomimic import export_robomimic, import_robomimic
from layflat.data.format import schema
from layflat.data.names import storable
from layflat.data.session.reader import Session, open_session
from layflat.data.types import Outcome
from layflat.sim.robots.registry import ROBOTS, robot_spec

Format: TypeAlias = Literal["robomimic", "lerobot", "csv", "minari", "rrd"]
EPISODE_S = 0.5
"""Expected wall time of the LeRobot export of one episode, for the first estimate of the time left."""


def export(
    path: Path,
    out: Path,
    *,
    form: Format,
    outcome: Outcome | None,
    valid_share: float,
    images: bool,
    seed: int,
    force: bool,
) -> None:
    """Write a session, or its episodes with this outcome, to ``out``: a file for robomimic, else a folder."""
    if not images and form in ("robomimic", "csv"):
        raise UsageError(f"--no-images is for lerobot, minari and rrd; {form} exports do not take it")
    with open_session(path) as session:
        names = chosen_names(session, outcome)
        if copies := session.copies(names):
            say(f"{path}: {copies_text(copies)}; all are exported; `layflat data merge` keeps one of each")
        if form == "robomimic":
            validators.writable_file(out, force=force, suffix=validators.SESSION_SUFFIXES)
            split = export_robomimic(session, out, names=names, valid_share=valid_share, seed=seed)
            counts = ", ".join(f"{len(members)} {key}" for key, members in split.items())
            print(f"exported {len(names)} episodes ({counts}) {out}")
            return
        new_folder(out, force=force)
        if form == "lerobot":
            from layflat.data.exchange.lerobot import export_lerobot

            with Progress({"export": EPISODE_S * len(names)}) as progress:
                progress.phase("export")
                share = 1 / len(names)
                written = export_lerobot(
                    session, out, names=names, images=images, on_episode=lambda name: progress.advance(share, name)
                )
            what = "with images" if written.images else "without images"
            print(f"exported {written.episodes} episodes, {written.frames} frames {what} {out}")
        elif form in ("minari", "rrd"):
            _export_episodes(session, out, names, form, images=images)
        else:
            from layflat.data.exchange.csv_export import export_csv

            print(f"exported {len(names)} episodes, {export_csv(session, out, names=names)} steps {out}")


def _export_episodes(session: Session, out: Path, names: Sequence[str], form: Format, *, images: bool) -> None:
    from layflat.data.exchange.minari import export_minari
    from layflat.data.exchange.rerun import export_rerun

    with Progress({"export": EPISODE_S * len(names)}) as progress:
        progress.phase("export")

        def advance(name: str) -> None:
            progress.advance(1 / len(names), name)

        if form == "minari":
            where = f"{export_minari(session, out, names=names, images=images, on_episode=advance)} in {out}"
        else:
            export_rerun(session, out, names=names, images=images, on_episode=advance)
            where = str(out)
    print(f"exported {len(names)} episodes {where}")


def import_file(path: Path, out: Path, *, cloth: str | None, force: bool) -> None:
    """Write a session from a robomimic file in our layout."""
    validators.readable_file(path, "a robomimic HDF5 file")
    validators.writable_file(out, force=force, suffix=validators.SESSION_SUFFIXES)
    report = import_robomimic(path, out, cloth=cloth, robots=[robot_spec(name) for name in ROBOTS], force=force)
    with open_session(out) as session:
        if copies := session.copies():
            say(f"{out}: {copies_text(copies)}")
    how = "copied bit by bit" if report.exact else "converted"
    print(f"imported {report.episodes} episodes, {how} {out}")


def video(path: Path, out: Path, *, episode: int, force: bool) -> None:
    """Write an episode as its camera saw it, with contact and WORD drawn on it, as a video."""
    with open_session(path) as session:
        recorded = session.episode(schema.demo_name(episode))
    validators.writable_file(out, force=force, suffix=".webm")
    check_drawable(recorded)
    with EpisodeRenderer() as renderer:
        count = write_episode_video(out, renderer.camera_frames(recorded), recorded)
    print(f"wrote {schema.demo_name(episode)}, {count} frames {out}")


def plot(path: Path, out: Path, *, episode: int | None, force: bool) -> None:
    """Draw a page of plots of a session, or of one of its episodes, as a PNG."""
    with open_session(path) as session:
        names = session.names if episode is None else (schema.demo_name(episode),)
        for name in names:
            session.info(name)
        validators.writable_file(out, force=force, suffix=".png")
        what = f"{len(names)} episodes" if episode is None else names[0]
        title = f"{storable(path.name)}: {what}, {session.robot}, {session.cloth}"
        count = plot_session(out, title, (curves_of(name, session.episode(name, images=False)) for name in names))
    print(f"plotted {count} episodes {out}")


def chosen_names(session: Session, outcome: Outcome | None) -> Sequence[str]:
    """Return the names of the episodes with this outcome; UsageError where there are none."""
    names = session.select(outcome=outcome)
    if not names:
        raise UsageError(
            f"none of the {len(session)} episodes of {session.path} is a {outcome}; choose another outcome"
        )
    return names


def new_folder(path: Path, *, force: bool) -> None:
    """Check that a folder can be created or replaced; UsageError otherwise."""
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path} is not a folder; this export makes a folder")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise UsageError(f"{path} is not empty; give --force to replace it, or another name")
    validators.writable_folder(path.absolute().parent)
