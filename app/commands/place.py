"""`layflat place`: autonomous placing with a policy, with or without a disturbance."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from layflat.app.media.frames import video_frames
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.media.video import write_video
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import UsageError, say
from layflat.app.support.formatting import percent, ratio
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.app.support.seeds import EVALUATION_SEED, taught_text
from layflat.app.support.session_lines import copy_note, kept_line
from layflat.app.workers.run_items import CollectedEpisodes, collect_items, read_images
from layflat.app.workers.sim_options import sim_config
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.app.workers.work_item import DisturbanceCase, WorkItem
from layflat.data.provenance import capture_provenance
from layflat.data.session.environment_recorder import recorder_for
from layflat.data.session.saved_episode import SavedEpisode
from layflat.policy.registry import WRAPPERS
from layflat.policy.schedule import ScheduledDisturbance
from layflat.policy.spec import PolicySpec
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import DEFAULT_ROBOT, ROBOTS, robot_spec

EPISODE_S = 18.0
VIDEO_WIDTH = 640
COLUMNS = ("seed", "placed", "disturbed", "final", "mesh contact", "flat area", "steps", "stopped by")


@dataclass(frozen=True, kw_only=True)
class PlaceConfig:
    """Settings of one `layflat place` call."""

    policy: str
    """POLICY text: a model file or a built-in name, with wrappers behind it."""
    episodes: int = 1
    seed: int = EVALUATION_SEED
    robot: str | None = None
    """Robot of a built-in policy; a model has its own."""
    cloth: str | None = None
    """By default the cloth that the model was trained with."""
    disturbance: str = "none"
    """Disturbance that starts when the policy has stopped."""
    wrappers: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    """Conditions, KEY=VALUE."""
    record: Path | None = None
    """Session in which to record the episodes."""
    video: Path | None = None
    """Video of the first episode."""
    json: Path | None = None
    station: Path | None = None
    """File of a real station in whose place there is no simulation; ``twin``: the digital twin."""
    slow: float = 1.0
    yes: bool = False


def place(config: PlaceConfig, *, workers: int, force: bool, make: EpisodeFactory = SimulatedEpisode) -> None:
    """Place from the starts of ``seed``, ``seed + 1``, ...; print a table, write files where asked for."""
    validators.one_of("disturbance", config.disturbance, DISTURBANCES)
    items = work_items(config)
    taught = [item.seed for item in items if item.is_taught]
    if taught:
        say(taught_text(items[0].policy.label, taught))
    for file, suffix in (
        (config.video, ".webm"), (config.record, validators.SESSION_SUFFIXES), (config.json, ".json"),
    ):  # fmt: skip
        if file is not None:
            validators.writable_file(file, suffix=suffix, force=force, append=file is config.record)
    if config.station is not None:
        _place_on_station(config, items)
        return
    with tempfile.TemporaryDirectory(prefix="layflat-place-") as folder:
        collected = _run(items, config.record, Path(folder), workers, make)
        first = None if config.video is None or collected.interrupt else read_images(items[0], Path(folder))
        if config.video is not None and first is not None:
            write_video(config.video, video_frames(first, PerceptionOverlay(first.camera), VIDEO_WIDTH))
    if config.json is not None and collected.all_rows:
        lost = len(collected.lost)
        provenance = vars(capture_provenance())
        write_json(
            config.json, {"episodes": collected.all_rows, "provenance": provenance, "lost": lost, "taught": taught}
        )
    if collected.rows:
        print_table(COLUMNS, map(_cells, collected.rows))
    collected.check()


def _place_on_station(config: PlaceConfig, items: list[WorkItem]) -> None:
    from layflat.app.commands.station import StationRun, run_on_station  # its libraries are optional

    for option, value in (("--video shows", config.video), ("--set changes", config.settings)):
        if value:
            raise UsageError(f"{option} a simulation; leave it out at a station")
    run = StationRun(
        station=config.station or Path(),
        policy=items[0].policy,
        seeds=tuple(item.seed for item in items),
        case=items[0].cases[0],
        record=config.record,
        json=config.json,
        slow=config.slow,
        yes=config.yes,
    )
    print_table(COLUMNS, map(_cells, run_on_station(run)))


def work_items(config: PlaceConfig) -> list[WorkItem]:
    """Return an item for each episode; UsageError or PolicyError where the settings do not fit."""
    for name in config.wrappers:
        validators.one_of("wrapper", name, WRAPPERS)
    policy = PolicySpec.parse("+".join((config.policy, *config.wrappers)))
    simulation = _simulation(config, policy)
    policy.check_task(simulation.task)
    schedule = () if config.disturbance == "none" else (ScheduledDisturbance(disturbance=config.disturbance),)
    case = DisturbanceCase(name=config.disturbance, schedule=schedule)
    return [
        WorkItem(
            policy=policy,
            config=simulation,
            seed=config.seed + k,
            cases=(case,),
            keep_images=config.video is not None and k == 0,
        )
        for k in range(config.episodes)
    ]


def _simulation(config: PlaceConfig, policy: PolicySpec) -> SimConfig:
    """Return the simulation in which the policy acts."""
    if policy.model is None:
        robot, cloth = config.robot or DEFAULT_ROBOT, config.cloth or DEFAULT_CLOTH
    else:
        taught, cloth = policy.model.layout.robot, config.cloth or policy.model.cloth
        robot = config.robot or taught.name
        if robot != taught.name and not robot_spec(validators.one_of("robot", robot, ROBOTS)).same_axes(taught):
            raise UsageError(f"{config.policy} was trained for robot {taught}, not {robot}")
    return sim_config(config.settings, robot=robot, cloth=cloth, descriptor=policy.descriptor)


def _run(
    items: list[WorkItem], record: Path | None, folder: Path, workers: int, make: EpisodeFactory
) -> CollectedEpisodes:
    """Run the items, and record them if asked to."""
    with ExitStack() as stack:
        recorder, simulation = None, items[0].config
        if record is not None:
            recorder = stack.enter_context(recorder_for(record, simulation.environment_spec()))
        progress = stack.enter_context(Progress({"placing": EPISODE_S * len(items) / workers}))
        for saved in recorder.recovered if recorder is not None else ():
            progress.note(kept_line(saved))

        def on_saved(saved: SavedEpisode) -> None:
            progress.note(kept_line(saved))
            if saved.copy_of is not None:
                progress.note(f"layflat: {copy_note(saved)}")

        progress.phase("placing", items=len(items))
        return collect_items(
            items,
            folder,
            progress,
            workers=workers,
            recorder=recorder,
            on_saved=on_saved,
            make=make,
        )


def _cells(row: dict[str, Any]) -> list[str]:
    portions = [row[name] for name in ("contact_placed", "contact_disturbed", "contact_final", "contact_final_true")]
    numbers = (*map(percent, portions), ratio(row["flat_area_final"]))
    return [str(row["seed"]), *numbers, str(row["steps"]), row["stopped_by"]]
