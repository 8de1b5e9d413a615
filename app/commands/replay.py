"""`layflat replay`: what a recorded episode was, or its actions once more and how far that leads elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from pebble import ProcessExpired
from rich.table import Table

from layflat.app.media.episode_renderer import EpisodeRenderer, check_drawable
from layflat.app.media.video import write_episode_video
from layflat.app.support import validators
from layflat.app.support.console import console
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.metrics import episode_metrics, write_json
from layflat.app.support.progress import Progress
from layflat.app.workers.process import process_pool
from layflat.app.workers.work_item import LIMIT_S
from layflat.data.arrays import FloatArray
from layflat.data.format import schema
from layflat.data.provenance import capture_provenance
from layflat.data.session.reader import open_session
from layflat.data.types import PHASES, Episode
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES, DisturbanceTrajectory
from layflat.sim.errors import SimError
from layflat.sim.simulation import ClothSimulation

Mode: TypeAlias = Literal["state", "action"]
STEP_WALL_S = 0.08
"""Expected wall time of a step, for the first estimate of the time left."""


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """How far a rerun is from the recording, at the start of each common step and after the last."""

    node_error_m: FloatArray
    """(T + 1,) m: the largest distance of a cloth node from where it was."""
    corner_error_m: FloatArray
    """(T + 1,) m: the same of the two held corners."""
    contact_error: FloatArray
    """(T + 1,) difference of the camera's contact portion, rerun minus recording."""
    identical: bool
    """Nodes, corners and contact are the same to the bit, and so is the number of steps."""

    @property
    def first_step(self) -> int | None:
        """The first moment at which anything differs, or None."""
        errors = self.node_error_m + self.corner_error_m + np.abs(self.contact_error)
        return int(np.flatnonzero(errors)[0]) if errors.any() else None


def replay(
    path: Path, *, episode: int, mode: Mode, json: Path | None = None, video: Path | None = None, force: bool = False
) -> None:
    """Show episode ``demo_<episode>`` of the session; a table on stdout, files where asked for."""
    if video is not None and video.suffix != ".webm":
        raise UsageError(f"{video} is not a .webm file; films are written as .webm")
    recorded = read_episode(path, episode)
    if video is not None:
        check_drawable(recorded)
    for file in (json, video):
        if file is not None:
            validators.writable_file(file, force=force)
    about = {"file": str(path), "episode": schema.demo_name(episode), "mode": mode}
    if mode == "state":
        shown, report = recorded, state_report(recorded)
        print_state(recorded)
    else:
        shown = rerun(recorded)
        divergence = compare(recorded, shown)
        report = action_report(recorded, shown, divergence)
        print_divergence(recorded, shown, divergence)
    if json is not None:
        write_json(json, {**about, **report})
    if video is not None:
        with EpisodeRenderer() as renderer:
            write_episode_video(video, renderer.scene_frames(shown), shown)


def read_episode(path: Path, number: int) -> Episode:
    """Episode ``demo_<number>``, without its images."""
    with open_session(path) as session:
        return session.episode(schema.demo_name(number), images=False)


# Actions once more


def rerun(recorded: Episode) -> Episode:
    """The recorded actions once more, from the same start, in a process that has never stepped a simulation."""
    _check_can_run(recorded)
    with Progress({"replay": STEP_WALL_S * len(recorded.steps)}) as progress, process_pool(1) as pool:
        progress.phase("replay")
        try:
            again: Episode = pool.schedule(_rerun_here, args=[recorded], timeout=LIMIT_S).result()
        except FutureTimeoutError:
            raise LayflatError(f"the replay took more than {LIMIT_S:.0f} s; its physics may hang") from None
        except ProcessExpired as error:
            raise LayflatError(f"the replay's process ended with status {error.exitcode}; try again") from None
        progress.advance()
    return again


def _check_can_run(recorded: Episode) -> None:
    validators.one_of("cloth", recorded.cloth, CLOTHS)
    if recorded.seed < 0:
        raise UsageError(f"the episode's seed is {recorded.seed}: its start is not known; replay it with --mode state")
    if recorded.first_step > 0:
        raise UsageError(
            f"the episode's first {recorded.first_step} steps were cut off, so it cannot be run again from its start;"
            " replay it with --mode state"
        )
    settings = settings_of(recorded)
    for record in recorded.disturbances:
        if not record.plan:
            validators.one_of("disturbance", record.name, DISTURBANCES)
            continue
        try:
            DisturbanceTrajectory.recorded(record.plan, settings.cloth_spec)
        except SimError as error:
            raise UsageError(str(error)) from None


def _rerun_here(recorded: Episode) -> Episode:
    from layflat.policy.rollout import replay_actions

    bench = ClothSimulation(settings_of(recorded))
    try:
        return replay_actions(bench, recorded)
    finally:
        bench.close()


def settings_of(recorded: Episode) -> SimConfig:
    """The bench that the episode was recorded on, as far as its file says so; UsageError where that is none."""
    usual = SimConfig(robot=recorded.robot.name, cloth=recorded.cloth)
    known = {field.name: type(getattr(usual, field.name)) for field in fields(usual) if field.init}
    told: dict[str, Any] = dict(recorded.sim_config) or {"table_friction": recorded.start.get("table_friction", 1.0)}
    for name, value in told.items():
        if known.get(name) is not type(value):
            raise UsageError(f"the episode's bench has {name} {value!r}, which this version does not know")
    try:
        own = {"robot": recorded.robot.name, "cloth": recorded.cloth, "descriptor": recorded.descriptor}
        return SimConfig(**(told | own | {"step_s": recorded.step_s}))
    except SimError as error:
        raise UsageError(f"the episode's bench is none of this version: {error}") from None


def compare(recorded: Episode, again: Episode) -> Divergence:
    """Both start at the same moment; what one of them has more of is not compared."""
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
    """Nodes (count, N, 3) m, corners (count, 2, 3) m and contact (count,) of the first moments."""
    nodes = np.array([ground_truth.nodes for ground_truth in episode.ground_truths()[:count]])
    corners = np.array([seen.corner_positions for seen in episode.observations()[:count]])
    return nodes, corners, episode.contact()[:count]


# What is told of it


def state_report(episode: Episode) -> dict[str, Any]:
    """The episode's row, what befell the cloth, and what was at each moment."""
    observations, ground_truths = episode.observations(), episode.ground_truths()
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
            "contact_portion_true": [ground_truth.contact_portion_true for ground_truth in ground_truths],
            "flat_area": [ground_truth.flat_area for ground_truth in ground_truths],
        },
    }


def action_report(recorded: Episode, again: Episode, divergence: Divergence) -> dict[str, Any]:
    """The divergence as a JSON object."""
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
        "changed_versions": changed_versions(recorded),
    }


def changed_versions(recorded: Episode) -> Mapping[str, list[str]]:
    """Package -> [version then, version now], of those that differ."""
    then, now = recorded.provenance.versions, capture_provenance().versions
    names = sorted({*then, *now})
    pairs = {name: [then.get(name, "none"), now.get(name, "none")] for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def print_state(episode: Episode) -> None:
    """One line per phase: when, and how the cloth lay."""
    table = Table("phase", "steps", "time", "contact", "mesh contact", "flat area")
    seen, ground_truths = episode.observations(), episode.ground_truths()
    for phase in PHASES:
        bounds = episode.phase_bounds(phase)
        if bounds is None:
            continue
        first, last = bounds
        table.add_row(
            phase,
            str(last - first),
            f"{seen[first].time_s:.1f} to {seen[last].time_s:.1f} s",
            f"{100 * seen[first].contact_portion:.1f} to {100 * seen[last].contact_portion:.1f} %",
            f"{100 * ground_truths[first].contact_portion_true:.1f} to "
            f"{100 * ground_truths[last].contact_portion_true:.1f} %",
            f"{ground_truths[first].flat_area:.3f} to {ground_truths[last].flat_area:.3f}",
        )
    out = console()
    out.print(
        f"{episode.source}, seed {episode.seed}, {episode.robot}, {episode.cloth}: {episode.outcome},"
        f" stopped by {episode.stopped_by}",
        markup=False,
        highlight=False,
    )
    out.print(table)


def print_divergence(recorded: Episode, again: Episode, divergence: Divergence) -> None:
    """One line: identical, or where and how far not; and what has changed since."""
    if divergence.identical:
        print(f"identical over {len(recorded.steps)} steps: nodes, corners and contact to the bit")
        return
    if len(recorded.steps) != len(again.steps):
        print(f"the recording has {len(recorded.steps)} steps; the replay ended after {len(again.steps)}")
    if divergence.first_step is not None:
        print(f"diverges at step {divergence.first_step}: {', '.join(differences(divergence))}")
    for name, (then, now) in changed_versions(recorded).items():
        print(f"{name} was {then}, now it is {now}")


def differences(divergence: Divergence) -> list[str]:
    """How far apart nodes, corners and contact get, each in a few words."""
    told = []
    for name, errors in (("nodes", divergence.node_error_m), ("corners", divergence.corner_error_m)):
        told.append(f"{name} by up to {1000 * errors.max():.3g} mm" if errors.any() else f"{name} identical")
    contact = np.abs(divergence.contact_error).max()
    return [*told, f"contact by up to {contact:.3g}" if contact else "contact identical"]
