"""`layflat data export|import|video|plot`: conversion of recorded episodes for other tools and people."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from layflat.app.media.episode_plots import curves_of, plot_session
from layflat.app.media.episode_renderer import EpisodeRenderer, check_drawable
from layflat.app.media.video import write_episode_video
from layflat.app.support import validators
from layflat.app.support.errors import UsageError, say
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import copies_text
from layflat.data.exchange.csv_export import export_csv
from layflat.data.exchange.lerobot import LeRobotOptions, TaskEpisodes, export_lerobot
from layflat.data.exchange.robomimic import VALID_SHARE, export_robomimic, import_robomimic
from layflat.data.format import schema
from layflat.data.names import storable
from layflat.data.session.reader import Session, open_session
from layflat.data.types import Outcome
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.sim.tasks import TASKS

Format: TypeAlias = Literal["robomimic", "lerobot", "csv", "minari", "rrd"]
FILE_SUFFIXES = (".csv", ".rrd", ".parquet", ".json", *validators.SESSION_SUFFIXES)
"""Ends of names that are files': a folder of such a name is a mistake."""
EPISODE_S = 0.5
"""Expected wall time of the LeRobot export of one episode, for the first estimate of the time left."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Settings of one `layflat data export` call."""

    form: Format = "robomimic"
    outcome: Outcome | None = None
    trim_idle: bool = False
    valid_share: float = VALID_SHARE
    seed: int = 0
    images: bool = True
    depth: bool = False
    task_texts: Sequence[str] = ()
    data_license: str = LeRobotOptions.licence

    def check(self, paths: Sequence[Path]) -> None:
        """Check that the options go together; UsageError otherwise."""
        given = {
            "--no-images": (not self.images, ("lerobot", "minari", "rrd")),
            "--trim-idle": (self.trim_idle, ("robomimic", "lerobot", "csv", "minari")),
            "--depth": (self.depth, ("lerobot",)),
            "--task-text": (bool(self.task_texts), ("lerobot",)),
            "--license": (self.data_license != LeRobotOptions.licence, ("lerobot",)),
        }
        for option, (there, forms) in given.items():
            if there and self.form not in forms:
                raise UsageError(f"{option} is for {', '.join(forms)}; {self.form} exports do not take it")
        if self.form != "lerobot" and len(paths) > 1:
            raise UsageError(f"{self.form} exports take one session, got {len(paths)}; merge them first")
        if self.depth and not self.images:
            raise UsageError("--depth needs images; remove --no-images")
        if len(self.task_texts) not in (0, 1, len(paths)):
            raise UsageError(
                f"got {len(self.task_texts)} --task-text for {len(paths)} sessions; give one, or one for each"
            )
        if not all(text.strip() for text in self.task_texts):
            raise UsageError("--task-text is empty; say what the robot does")


def export(paths: Sequence[Path], out: Path, options: ExportOptions, *, force: bool) -> None:
    """Write sessions, or their episodes with this outcome, to ``out``: a file for robomimic, else a folder."""
    options.check(paths)
    with ExitStack() as stack:
        sessions = [stack.enter_context(open_session(path)) for path in paths]
        chosen = [chosen_names(session, options.outcome) for session in sessions]
        kept = "one of each is" if options.form == "lerobot" else "all are"
        for session, names in zip(sessions, chosen, strict=True):
            if copies := session.copies(names):
                text = copies_text(copies)
                say(f"{session.path}: {text}; {kept} exported; `layflat data merge` keeps one of each")
        if options.form == "robomimic":
            validators.writable_file(out, force=force, suffix=validators.SESSION_SUFFIXES)
        else:
            new_folder(out, force=force)
        if options.form == "lerobot":
            _export_lerobot(sessions, chosen, out, options)
        else:
            _export_session(sessions[0], chosen[0], out, options)


def _export_session(session: Session, names: Sequence[str], out: Path, options: ExportOptions) -> None:
    if options.form == "robomimic":
        split = export_robomimic(
            session,
            out,
            names=names,
            valid_share=options.valid_share,
            seed=options.seed,
            trim_idle=options.trim_idle,
        )
        counts = ", ".join(f"{len(members)} {key}" for key, members in split.items())
        print(f"exported {len(names)} episodes ({counts}) {out}")
    elif options.form == "csv":
        steps = export_csv(session, out, names=names, trim_idle=options.trim_idle)
        print(f"exported {len(names)} episodes, {steps} steps {out}")
    else:
        _export_episodes(session, out, names, options)


def _export_lerobot(
    sessions: Sequence[Session], chosen: Sequence[Sequence[str]], out: Path, options: ExportOptions
) -> None:
    texts = list(options.task_texts) or [
        TASKS[session.task].instruction.format(cloth=session.cloth, robot=session.robot)
        if session.task in TASKS
        else f"{session.task} ({session.cloth}, {session.robot})"
        for session in sessions
    ]
    texts *= len(sessions) // len(texts)
    sources = [
        TaskEpisodes(session=session, names=names, task_text=text)
        for session, names, text in zip(sessions, chosen, texts, strict=True)
    ]
    settings = LeRobotOptions(
        images=options.images, depth=options.depth, trim_idle=options.trim_idle, licence=options.data_license
    )
    count = sum(map(len, chosen))
    with Progress({"export": EPISODE_S * count}) as progress:
        progress.phase("export")
        written = export_lerobot(sources, out, settings, on_episode=lambda name: progress.advance(1 / count, name))
    what = "with images" if written.images else "without images"
    print(f"exported {written.episodes} episodes, {written.frames} frames {what} {out}")


def _export_episodes(session: Session, out: Path, names: Sequence[str], options: ExportOptions) -> None:
    from layflat.data.exchange.minari import export_minari
    from layflat.data.exchange.rerun import export_rerun

    with Progress({"export": EPISODE_S * len(names)}) as progress:
        progress.phase("export")

        def advance(name: str) -> None:
            progress.advance(1 / len(names), name)

        if options.form == "minari":
            name = export_minari(
                session, out, names=names, images=options.images, trim_idle=options.trim_idle, on_episode=advance
            )
            where = f"{name} in {out}"
        else:
            export_rerun(session, out, names=names, images=options.images, on_episode=advance)
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
    if (path.exists() and not path.is_dir()) or path.suffix in FILE_SUFFIXES:
        raise UsageError(f"{path} is not a folder; this export makes a folder")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise UsageError(f"{path} is not empty; give --force to replace it, or another name")
    validators.writable_folder(path.absolute().parent)
