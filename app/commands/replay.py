"""`layflat replay`: a recorded episode as it was, or its actions run again and how far that diverges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from pebble import ProcessExpired

from layflat.app.media.episode_renderer import EpisodeRenderer, check_drawable
from layflat.app.media.video import write_episode_video
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import LayflatError, UsageError, say
from layflat.app.support.formatting import percent, ratio
from layflat.app.support.metrics import episode_metrics, write_json
from layflat.app.support.phases import phase_spans
from layflat.app.support.progress import Progress
from layflat.app.workers.process import describe_exit_status, process_pool
from layflat.app.workers.sim_options import parse_conditions, sim_config
from layflat.app.workers.work_item import LIMIT_S
from layflat.data.arrays import FloatArray
from layflat.data.format import schema
from layflat.data.provenance import capture_provenance
from layflat.data.session.reader import open_session
from layflat.data.types import Episode
from layflat.policy.rollout import replay_actions
from layflat.sim.cloth.registry import PREFIX, recorded_cloth
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES, DisturbanceTrajectory
from layflat.sim.errors import SimError
from layflat.sim.simulation import ClothSimulation

MODES = ("state", "action")
STEP_WALL_S = 0.08
"""Expected wall time of a step, for the first estimate of the time left."""


@dataclass(frozen=True, kw_only=True)
class ReplayConfig:
    """Settings of one `layflat replay` call."""

    path: Path
    episode: int
    """Number of the episode: 3 for ``demo_3``."""
    mode: str = MODES[0]
    """``state`` shows the recording; ``action`` runs its actions again from the same start."""
    settings: tuple[str, ...] = ()
    """Conditions, KEY=VALUE, in place of the recorded ones."""
    json: Path | None = None
    video: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """Distance of a rerun from the recording, at the start of each common step and after the last."""

    node_error_m: FloatArray
    """(T + 1,) m: the largest distance of a cloth node from its recorded position."""
    corner_error_m: FloatArray
    """(T + 1,) m: the same of the two held corners."""
    contact_error: FloatArray
    """(T + 1,) difference of the camera's contact portion, rerun minus recording."""
    identical: bool
    """Whether nodes, corners, contact and the number of steps are the same to the bit."""

    @property
    def first_step(self) -> int | None:
        """First step at whose start anything differs, or None."""
        errors = self.node_error_m + self.corner_error_m + np.abs(self.contact_error)
        return int(np.flatnonzero(errors)[0]) if errors.any() else None


def replay(config: ReplayConfig, *, force: bool) -> None:
    """Replay an episode of a session; print a table, write files where asked for."""
    validators.one_of("mode", config.mode, MODES)
    if config.settings and config.mode != "action":
        raise UsageError("--set changes what actions do; give --mode action with it")
    name = schema.demo_name(config.episode)
    with open_session(config.path) as session:
        recorded = session.episode(name, images=False)
        trimmed = name in session.edits and session.edits[name].bounds is not None
    if trimmed and config.mode == "action":
        # Only from the recorded start is the cloth where the actions found it.
        with open_session(config.path, edits=False) as session:
            recorded = session.episode(name, images=False)
        say(f"{name} is trimmed; its actions are replayed as recorded")
    for file, suffix in ((config.video, ".webm"), (config.json, ".json")):
        if file is not None:
            validators.writable_file(file, suffix=suffix, force=force)
    if config.video is not None:
        check_drawable(recorded)
    about = {"file": str(config.path), "episode": name, "mode": config.mode}
    if config.mode == "state":
        shown, report = recorded, state_report(recorded)
        print_state(recorded)
    else:
        shown = rerun(recorded, config.settings)
        divergence = compare(recorded, shown)
        report = action_report(recorded, shown, divergence)
        print_divergence(recorded, shown, divergence)
    if config.json is not None:
        write_json(config.json, {**about, **report})
    if config.video is not None:
        with EpisodeRenderer() as renderer:
            write_episode_video(config.video, renderer.scene_frames(shown), shown)


# The actions again


def rerun(recorded: Episode, conditions: Sequence[str] = ()) -> Episode:
    """Run the recorded actions from the same start, in a process that has never stepped a simulation."""
    physics = parse_conditions(conditions).get("physics", recorded.physics)
    if physics != recorded.physics:
        raise UsageError(f"the actions were recorded in physics {recorded.physics} and mean nothing in {physics}")
    simulation = recorded_config(recorded, conditions)
    _check_disturbances(recorded, simulation)
    with Progress({"replay": STEP_WALL_S * len(recorded.steps)}) as progress, process_pool(1) as pool:
        progress.phase("replay")
        try:
            again: Episode = progress.wait(pool.schedule(_rerun_here, args=[simulation, recorded], timeout=LIMIT_S))
        except FutureTimeoutError:
            raise LayflatError(f"the replay took more than {LIMIT_S:.0f} s; its physics may hang") from None
        except ProcessExpired as error:
            raise LayflatError(
                f"the replay was lost: {describe_exit_status(error.exitcode, LIMIT_S)}; try again"
            ) from None
        progress.advance()
    return again


def _rerun_here(simulation: SimConfig, recorded: Episode) -> Episode:
    env = ClothSimulation(simulation)
    try:
        return replay_actions(env, recorded)
    finally:
        env.close()


def recorded_config(recorded: Episode, conditions: Sequence[str] = ()) -> SimConfig:
    """Return the simulation in which an episode was recorded; UsageError where it cannot run again from its start.

    ``conditions``, KEY=VALUE, replace the recorded ones.
    """
    if recorded.seed < 0:
        raise UsageError(f"the episode's seed is {recorded.seed}: its start is not known; replay it with --mode state")
    if recorded.first_step > 0:
        raise UsageError(
            f"the episode's first {recorded.first_step} steps were cut off, so it cannot be run again from its start;"
            " replay it with --mode state"
        )
    names = {key: getattr(recorded, key) for key in ("task", "physics", "descriptor")}
    try:
        cloth = recorded_cloth(recorded.cloth, recorded.sim_config)
    except SimError as error:
        raise UsageError(str(error)) from None
    own: dict[str, Any] = {
        "robot": recorded.robot.name,
        **names,
        "step_s": recorded.step_s,
        "cloth": cloth.name,
        "own_cloth": cloth,
    }
    usual = sim_config(**own)
    known = {field.name: type(getattr(usual, field.name)) for field in fields(usual) if field.init}
    settings: dict[str, Any] = dict(recorded.sim_config)
    settings = settings or {"table_friction": recorded.start.get("table_friction", 1.0)}
    settings = {name: value for name, value in settings.items() if not name.startswith(PREFIX)}
    for name, value in settings.items():
        if known.get(name) is not type(value):
            raise UsageError(f"the episode's simulation has {name} {value!r}, which this version does not know")
    return sim_config(conditions, **(settings | own))


def _check_disturbances(recorded: Episode, simulation: SimConfig) -> None:
    for record in recorded.disturbances:
        if not record.plan:
            validators.one_of("disturbance", record.name, DISTURBANCES)
            continue
        try:
            DisturbanceTrajectory.recorded(record.plan, simulation.cloth_spec)
        except SimError as error:
            raise UsageError(str(error)) from None


def compare(recorded: Episode, again: Episode) -> Divergence:
    """Compare two episodes from the same start, as far as both have steps."""
    count = min(len(recorded.steps), len(again.steps)) + 1
    pairs = [_tracks(episode, count) for episode in (recorded, again)]
    (nodes, corners, contact), (nodes_again, corners_again, contact_again) = pairs
    same = all(np.array_equal(a, b) for a, b in zip(*pairs, strict=True))
    return Divergence(
        node_error_m=np.linalg.norm(nodes_again - nodes, axis=2).max(axis=1),
        corner_error_m=np.linalg.norm(corners_again - corners, axis=2).max(axis=1),
        contact_error=contact_again - contact,
        identical=same and len(recorded.steps) == len(again.steps),
    )


def _tracks(episode: Episode, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nodes (count, N, 3) m, corners (count, 2, 3) m and contact (count,) of the first steps."""
    nodes = np.array([truth.nodes for truth in episode.ground_truths()[:count]])
    corners = np.array([seen.corner_positions for seen in episode.observations()[:count]])
    return nodes, corners, episode.contact()[:count]


# Reports


def state_report(episode: Episode) -> dict[str, Any]:
    """Return the episode's row, its disturbances, and its state at the start of each step and after the last."""
    observations = episode.observations()
    truths = [*(step.ground_truth for step in episode.steps), episode.final_ground_truth]
    return {
        "row": episode_metrics(episode),
        "disturbances": [vars(record) for record in episode.disturbances],
        "forces_n": [step.force_n.tolist() for step in episode.steps],
        "per_step": {
            "phase": [step.phase for step in episode.steps],
            "time_s": [seen.time_s for seen in observations],
            "corner_positions_m": [seen.corner_positions.tolist() for seen in observations],
            "word": [seen.word.tolist() for seen in observations],
            "contact_portion": episode.contact().tolist(),
            "contact_portion_true": [None if truth is None else truth.contact_portion_true for truth in truths],
            "flat_area": [None if truth is None else truth.flat_area for truth in truths],
        },
    }


def action_report(recorded: Episode, again: Episode, divergence: Divergence) -> dict[str, Any]:
    """Return the divergence as a JSON object."""
    return {
        "identical": divergence.identical,
        "max_node_error_m": float(divergence.node_error_m.max()),
        "max_corner_error_m": float(divergence.corner_error_m.max()),
        "max_contact_error": float(np.abs(divergence.contact_error).max()),
        "first_divergent_step": divergence.first_step,
        "steps": len(recorded.steps),
        "steps_again": len(again.steps),
        "per_step": {
            "node_error_m": divergence.node_error_m.tolist(),
            "corner_error_m": divergence.corner_error_m.tolist(),
            "contact_error": divergence.contact_error.tolist(),
        },
        "changed_versions": version_changes(recorded),
    }


def version_changes(recorded: Episode) -> Mapping[str, list[str]]:
    """Return the packages that have another version now: name -> [version then, version now]."""
    then, now = recorded.provenance.versions, capture_provenance().versions
    pairs = {name: [then.get(name, "none"), now.get(name, "none")] for name in sorted({*then, *now})}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def print_state(episode: Episode) -> None:
    """Print one line per phase: its time, and contact and flat area at its ends."""
    columns = state_report(episode)["per_step"]

    def ends(name: str, first: int, end: int, cell: Any = percent) -> str:
        return f"{cell(columns[name][first])} to {cell(columns[name][end])}"

    rows = [
        (
            span.phase,
            str(span.end - span.first),
            ends("time_s", span.first, span.end, "{:.1f}".format) + " s",
            ends("contact_portion", span.first, span.end),
            ends("contact_portion_true", span.first, span.end),
            ends("flat_area", span.first, span.end, ratio),
        )
        for span in phase_spans(episode)
    ]
    print(
        f"{episode.source}, seed {episode.seed}, {episode.robot}, {episode.cloth}: {episode.outcome},"
        f" stopped by {episode.stopped_by}"
    )
    print_table(("phase", "steps", "time", "contact", "mesh contact", "flat area"), rows, left=6)


def print_divergence(recorded: Episode, again: Episode, divergence: Divergence) -> None:
    """Print whether the rerun is identical, or where and how far not, and which versions have changed."""
    if divergence.identical:
        print(f"identical over {len(recorded.steps)} steps: nodes, corners and contact to the bit")
        return
    if len(recorded.steps) != len(again.steps):
        print(f"the recording has {len(recorded.steps)} steps; the replay ended after {len(again.steps)}")
    if divergence.first_step is not None:
        print(f"diverges at step {divergence.first_step}: {', '.join(differences(divergence))}")
    for name, (then, now) in version_changes(recorded).items():
        print(f"{name} was {then}, now it is {now}")


def differences(divergence: Divergence) -> list[str]:
    """Return how far apart nodes, corners and contact get, each in a few words."""
    words = []
    for name, errors in (("nodes", divergence.node_error_m), ("corners", divergence.corner_error_m)):
        words.append(f"{name} by up to {1000 * errors.max():.3g} mm" if errors.any() else f"{name} identical")
    contact = np.abs(divergence.contact_error).max()
    return [*words, f"contact by up to {contact:.3g}" if contact else "contact identical"]
