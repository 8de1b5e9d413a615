"""`layflat place`: autonomous placing with a policy, disturbed if wished."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from layflat.app.media.frames import video_frames
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.media.video import write_video
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import UsageError
from layflat.app.support.formatting import percent, ratio
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import kept_line
from layflat.app.workers.run_items import EpisodeCollector, read_first, record_items, run_items
from layflat.app.workers.work_item import NO_DISTURBANCE, DisturbanceCase, WorkItem, WorkResult
from layflat.data.provenance import capture_provenance
from layflat.data.session.recorder import SessionRecorder
from layflat.policy.schedule import ScheduledDisturbance
from layflat.policy.spec import PolicySpec
from layflat.sim.cloth.spec import CLOTHS, DEFAULT_CLOTH
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import ROBOTS, robot_spec

EPISODE_S = 18.0
FILM_WIDTH = 640
COLUMNS = ("seed", "placed", "disturbed", "final", "mesh contact", "flat area", "steps", "stopped by")


@dataclass(frozen=True, kw_only=True)
class PlaceConfig:
    """Settings of one `layflat place` call."""

    policy: str
    """POLICY text: a model file or a built-in name, with wrappers behind it."""
    episodes: int = 1
    seed: int = 0
    robot: str | None = None
    """Robot of a built-in policy; a model has its own."""
    cloth: str | None = None
    """By default the cloth that the model was trained with."""
    disturbance: str = "none"
    """Disturbance that starts when the policy has stopped."""
    wrappers: tuple[str, ...] = ()
    record: Path | None = None
    video: Path | None = None
    json: Path | None = None


def place(config: PlaceConfig, *, workers: int, force: bool) -> None:
    """Place from the starts of ``seed``, ``seed + 1``, ...; print a table, write files where asked for."""
    policy = PolicySpec.parse("+".join((config.policy, *config.wrappers)))
    disturbance = validators.one_of("disturbance", config.disturbance, DISTURBANCES)
    for file, append in ((config.record, True), (config.video, False), (config.json, False)):
        if file is not None:
            validators.writable_file(file, force=force, append=append)
    if config.video is not None and config.video.suffix != ".webm":
        raise UsageError(f"{config.video} is not a .webm file; videos are written as .webm")
    simulation = _simulation(config, policy)
    schedule = () if disturbance == "none" else (ScheduledDisturbance(disturbance=disturbance),)
    case = DisturbanceCase(name=disturbance, schedule=schedule) if schedule else NO_DISTURBANCE
    items = [
        WorkItem(
            policy=policy,
            config=simulation,
            seed=config.seed + k,
            cases=(case,),
            keep_images=config.video is not None and k == 0,
        )
        for k in range(config.episodes)
    ]
    collector = EpisodeCollector()
    with tempfile.TemporaryDirectory(prefix="layflat-place-") as name:
        folder = Path(name)
        with collector.finish_on_interrupt():
            _run(items, config.record, folder, workers, collector)
        if config.video is not None and not collector.interrupted:
            first = read_first(items[0], folder)
            if first is not None:
                write_video(config.video, video_frames(first, PerceptionOverlay(), FILM_WIDTH))
    if config.json is not None and (collector.all_rows or not collector.interrupted):
        content = {
            "episodes": collector.all_rows,
            "provenance": vars(capture_provenance()),
            "lost": len(collector.lost),
        }
        write_json(config.json, content)
    if collector.rows:
        print_table(COLUMNS, map(_cells, sorted(collector.rows, key=lambda row: row["seed"])))
    collector.check()


def _simulation(config: PlaceConfig, policy: PolicySpec) -> SimConfig:
    """Return the simulation in which the policy acts."""
    if policy.model is None:
        robot, cloth = config.robot or next(iter(ROBOTS)), config.cloth or DEFAULT_CLOTH
    else:
        robot, cloth = policy.model.layout.robot.name, config.cloth or policy.model.cloth
        if config.robot not in (None, robot):
            raise UsageError(f"{config.policy} was trained for robot {robot}, not {config.robot}")
    return SimConfig(
        robot=validators.one_of("robot", robot, ROBOTS),
        cloth=validators.one_of("cloth", cloth, CLOTHS),
        descriptor=policy.descriptor,
    )


def _run(
    items: Sequence[WorkItem], record: Path | None, folder: Path, workers: int, collector: EpisodeCollector
) -> None:
    """Run the items, and record them if asked to."""
    with ExitStack() as stack:
        recorder = None
        if record is not None:
            simulation = items[0].config
            recorder = stack.enter_context(
                SessionRecorder(
                    record,
                    robot=robot_spec(simulation.robot),
                    cloth=simulation.cloth,
                    descriptor=simulation.descriptor,
                )
            )
        progress = stack.enter_context(Progress({"placing": EPISODE_S * len(items) / workers}))
        for recovered in recorder.recovered if recorder is not None else ():
            progress.note(kept_line(recovered))
        progress.phase("placing", items=len(items))
        results = stack.enter_context(closing(_results(items, recorder, folder, progress, workers)))
        for result in results:
            collector.add(result, progress, lambda row: f"contact {row['contact_final']:.2f}, {row['stopped_by']}")


def _results(
    items: Sequence[WorkItem], recorder: SessionRecorder | None, folder: Path, progress: Progress, workers: int
) -> Generator[WorkResult, None, None]:
    if recorder is None:
        yield from run_items(items, folder, workers=workers)
        return
    for result, saved in record_items(items, recorder, folder, workers=workers):
        if saved is not None:
            progress.note(kept_line(saved))
        yield result


def _cells(row: dict[str, Any]) -> list[str]:
    portions = [row[name] for name in ("contact_placed", "contact_disturbed", "contact_final", "contact_final_true")]
    return [
        str(row["seed"]),
        *map(percent, portions),
        ratio(row["flat_area_final"]),
        str(row["steps"]),
        row["stopped_by"],
    ]
