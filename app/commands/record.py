"""`layflat record`: demonstrations into a session file, each durable when it is printed."""

from __future__ import annotations

from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import copy_note, kept_line
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workers.run_items import collect_items, demonstrations
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.app.workstation.session.session_queries import next_seeds, skipped_text
from layflat.data.session.environment_recorder import recorder_for
from layflat.data.session.saved_episode import SavedEpisode
from layflat.policy.spec import SCRIPTED

EPISODE_S = 15.0
"""Expected wall time of a demonstration, for the first estimate of the time left."""


def record(config: RecordConfig, *, force: bool, workers: int, make: EpisodeFactory = SimulatedEpisode) -> None:
    """Record demonstrations; print one line on stdout for each."""
    if config.correct is not None and config.source == SCRIPTED:
        raise UsageError("--correct needs a person who takes over; give --source keyboard or --source gamepad")
    simulation, variation = config.sim_config(), config.variation()
    if config.source != SCRIPTED:
        # Imported here: pygame is only needed where a person demonstrates.
        from layflat.app.workstation.teleop.registry import TELEOPERATORS

        validators.one_of("source", config.source, (SCRIPTED, *TELEOPERATORS))
    path, episodes = config.path, config.episodes
    if force and path.is_file():
        raise UsageError(f"record appends to {path} and never replaces it; give another name, or delete it yourself")
    validators.writable_file(path, force=False, append=True, suffix=validators.SESSION_SUFFIXES)
    if config.station is not None:
        if config.settings or config.vary:
            raise UsageError("--set and --vary change a simulation; leave them out at a station")
        from layflat.app.commands.station_record import record_on_station  # its libraries are optional

        record_on_station(config)
        return
    if config.source != SCRIPTED:
        from layflat.app.workstation.teleop_record import record_teleoperated

        record_teleoperated(config)
        return
    with (
        recorder_for(path, simulation.environment_spec(), save_images=config.images) as recorder,
        Progress({"demonstrations": EPISODE_S * episodes / workers}) as progress,
    ):
        for saved in recorder.recovered:
            print_saved(saved)
        # After the recovery, which may bring back whole episodes.
        seeds, skipped = next_seeds(path, SCRIPTED, episodes, config.seed)
        if skipped:
            progress.note(f"layflat: {skipped_text(path, skipped, seeds)}")
        items = demonstrations(simulation, seeds, keep_images=config.images, variation=variation)

        def on_saved(saved: SavedEpisode) -> None:
            print_saved(saved)
            if saved.copy_of is not None:
                progress.note(f"layflat: {copy_note(saved)}")

        progress.phase("demonstrations", items=episodes)
        collected = collect_items(
            items, path.parent, progress, workers=workers, recorder=recorder, on_saved=on_saved, make=make
        )
    collected.check()


def print_saved(saved: SavedEpisode) -> None:
    """Print the line of an episode that is durable, at once."""
    print(kept_line(saved), flush=True)
