"""`layflat record`: demonstrations into a session file, each durable when it is printed."""

from __future__ import annotations

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import kept_line
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workers.run_items import demonstrations, record_all
from layflat.data.session.recorder import SessionRecorder
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.policy.spec import SCRIPTED
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS, robot_spec

EPISODE_S = 15.0
"""Expected wall time of a demonstration, for the first estimate of the time left."""


def record(config: RecordConfig, *, force: bool, workers: int) -> None:
    """Record demonstrations; print one line on stdout for each."""
    if config.correct is not None and config.source == SCRIPTED:
        raise UsageError("--correct needs a person who takes over; give --source keyboard or --source gamepad")
    validators.one_of("robot", config.robot, ROBOTS)
    validators.one_of("cloth", config.cloth, CLOTHS)
    validators.one_of("descriptor", config.descriptor, DESCRIPTORS)
    path, episodes = config.path, config.episodes
    if force and path.exists() and path.is_file():
        raise UsageError(f"record appends to {path} and never replaces it; give another name, or delete it yourself")
    validators.writable_file(path, force=False, append=True)
    if config.source != SCRIPTED:
        from layflat.app.workstation.session.teleop_record import record_teleoperated

        record_teleoperated(config)
        return
    with (
        SessionRecorder(
            path,
            robot=robot_spec(config.robot),
            cloth=config.cloth,
            save_images=config.images,
            descriptor=config.descriptor,
        ) as recorder,
        Progress({"demonstrations": EPISODE_S * episodes / workers}) as progress,
    ):
        for saved in recorder.recovered:
            print(kept_line(saved), flush=True)
        progress.phase("demonstrations", items=episodes)
        items = demonstrations(
            SimConfig(robot=config.robot, task=config.task, cloth=config.cloth, descriptor=config.descriptor),
            range(config.seed, config.seed + episodes),
            keep_images=config.images,
        )
        lost = record_all(items, recorder, progress, workers=workers, echo=True)
    if lost:
        reason = next(iter(lost[0].lost.values()))
        raise LayflatError(f"{len(lost)} of {episodes} demonstrations were lost: {reason}; the others are kept")
