"""`layflat demo`: the whole story once, headless: demonstrate, learn, place, disturb, report.

DIR gets the demonstrations (HDF5), the models, one row per episode, and report.html. A demo that was interrupted goes
on where it stopped: demonstrations and models that are there are used again.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd

from layflat.app.commands.record import keep_all
from layflat.app.commands.train import successful_demonstrations
from layflat.app.media.frames import contact_sheet, disturbance_steps, frame_strip, placing_steps
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.media.png import write_png
from layflat.app.report.demo import FRAME_WIDTH, ReportInput, RobotResults, pictured_run, write_report
from layflat.app.support import validators
from layflat.app.support.atomic_write import write_text
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.metrics import COLUMNS, episode_metrics, write_json
from layflat.app.support.progress import Progress
from layflat.app.support.provenance import capture_provenance
from layflat.app.support.statistics import summary
from layflat.app.workers.episode_pool import EpisodeConfig, EpisodeFailure, process_pool, run_episodes
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import Episode
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy import model_io as model_files
from layflat.policy import registry
from layflat.policy.trained_model import RegressionModel, TrainedModel
from layflat.sim.cloth.cloth import CLOTHS
from layflat.sim.robots.registry import robot_spec

DEMONSTRATIONS = 10
"""As many as the thesis gave its robot (chapter 4-3-2)."""
DEMONSTRATION_SEED = 1000
"""Demonstrations and placements never share a start."""
DISTURBANCE = "thesis"
FINISH = "gp-finish"
POLICIES = ("gp-baseline", "gp-word", FINISH)
RULE = "drag-rule"
FINISHER = "+".join((FINISH, *registry.RECOMMENDED_WRAPPERS))
"""The policy that goes past the thesis's."""
DEMONSTRATION_S = 12.0
RUN_S = 16.0
TRAINING_S: Mapping[str, float] = {"hanger": 15.0, "pickers": 60.0}
REPORT_S = 25.0
"""Core-seconds of one item, for the first estimate of the time left."""


def run_demo(
    out: Path, *, episodes: int, seed: int, robots: tuple[str, ...], cloth: str, workers: int, force: bool
) -> Path:
    """Run the story into ``out`` and print where the report is; returns the report's path."""
    validators.one_of("cloth", cloth, CLOTHS)
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out} is not a folder; give another --out")
    validators.writable_folder(out)
    report = out / "report.html"
    if report.exists() and not force:
        raise UsageError(f"{report} exists; give --force to make everything anew, or another --out")
    if force:
        _clear(out, robots)
    results = []
    notes: list[str] = []
    with Progress(_phases(robots, episodes, workers)) as progress:
        for robot in robots:
            demonstrations = _demonstrate(out, robot, cloth, seed, workers, progress)
            models = _learn(out, robot, seed, workers, progress)
            # What FINISH rolls out are the processes of gp-word: shown once.
            fields = {
                name: model for name, model in models.items() if isinstance(model, RegressionModel) and name != FINISH
            }
            runs, lost = _place(robot, cloth, models, episodes, seed, workers, progress)
            notes += [f"{robot} robot, {f.job.source}, seed {f.job.seed}: lost, {f.reason}" for f in lost]
            results.append(
                RobotResults(
                    robot=robot,
                    cloth=cloth,
                    demonstrations=demonstrations,
                    models=fields,
                    runs=runs,
                    draw=PerceptionOverlay(),
                )
            )
            _write_rows(out, [e for r in results for group in r.runs.values() for e in group])
        progress.phase("report", items=1)
        content = ReportInput(robots=tuple(results), provenance=capture_provenance(), seed=seed, notes=tuple(notes))
        write_report(report, content, on_progress=progress.status)
        _draw_frames(out / "frames.png", results[0])
        progress.advance()
    print(f"report: {report}")
    return report


def _phases(robots: Sequence[str], episodes: int, workers: int) -> dict[str, float]:
    phases: dict[str, float] = {}
    for robot in robots:
        phases[f"{robot}: demonstrations"] = DEMONSTRATION_S * DEMONSTRATIONS / workers
        phases[f"{robot}: training"] = TRAINING_S[robot]
        phases[f"{robot}: placing and disturbance"] = RUN_S * episodes * (len(POLICIES) + 1) / workers
    phases["report"] = REPORT_S
    return phases


def _clear(out: Path, robots: Sequence[str]) -> None:
    """Remove what an earlier demo wrote there, and nothing else."""
    names = [f"demonstrations-{robot}.h5" for robot in robots] + [
        "episodes.csv",
        "summary.json",
        "report.html",
        "frames.png",
    ]
    names += [f"{policy}-{robot}.npz" for policy in POLICIES for robot in robots]
    for name in names:
        (out / name).unlink(missing_ok=True)
        shutil.rmtree(out / f"{name}.parts", ignore_errors=True)


def _demonstrate(out: Path, robot: str, cloth: str, seed: int, workers: int, progress: Progress) -> tuple[Episode, ...]:
    """Record what is missing of the demonstrations; all of them, in the order of their seeds."""
    path = out / f"demonstrations-{robot}.h5"
    wanted = [DEMONSTRATION_SEED + seed + k for k in range(DEMONSTRATIONS)]
    there = set()
    if path.exists() or path.with_name(path.name + ".parts").exists():
        with open_session(path) as session:
            there = {session.info(name).seed for name in session.names}
    missing = [s for s in wanted if s not in there]
    progress.phase(f"{robot}: demonstrations", items=DEMONSTRATIONS)
    progress.advance(len(wanted) - len(missing))
    with SessionRecorder(path, robot=robot_spec(robot), cloth=cloth, descriptor=DEFAULT_DESCRIPTOR) as recorder:
        jobs = [EpisodeConfig(robot=robot, cloth=cloth, seed=s) for s in missing]
        lost = keep_all(jobs, recorder, progress, workers=workers, echo=False)
    if lost:
        raise LayflatError(
            f"{len(lost)} demonstrations were lost: {lost[0].reason}; the same command goes on from here"
        )
    with open_session(path) as session:
        return tuple(sorted(session.episodes(images=False), key=lambda episode: episode.seed))


def _learn(out: Path, robot: str, seed: int, workers: int, progress: Progress) -> dict[str, TrainedModel]:
    """Train the policies, each in a process of its own, or load what an earlier run trained."""
    path = out / f"demonstrations-{robot}.h5"
    progress.phase(f"{robot}: training", items=len(POLICIES))
    files = {policy: out / f"{policy}-{robot}.npz" for policy in POLICIES}
    missing = [policy for policy, file in files.items() if not file.exists()]
    progress.advance(len(POLICIES) - len(missing))
    with process_pool(min(workers, len(POLICIES))) as pool:
        futures: dict[str, Future[TrainedModel]] = {
            policy: pool.schedule(_train, args=[path, policy, seed]) for policy in missing
        }
        for policy, future in futures.items():
            model = future.result()
            model_files.save(model, files[policy], force=True)
            rmse = "" if model.heldout_rmse_m is None else f", held-out {1000 * max(model.heldout_rmse_m):.1f} mm"
            progress.advance(status=f"{policy}: {model.n_points} points{rmse}")
    return {policy: model_files.load(file) for policy, file in files.items()}


def _train(path: Path, policy: str, seed: int) -> TrainedModel:
    return registry.train(policy, successful_demonstrations(path), seed=seed, provenance=capture_provenance())


def _place(
    robot: str,
    cloth: str,
    models: dict[str, TrainedModel],
    episodes: int,
    seed: int,
    workers: int,
    progress: Progress,
) -> tuple[dict[str, tuple[Episode, ...]], list[EpisodeFailure]]:
    """Every policy from the same starts, through the same disturbances; and the baseline with a rule for repair."""
    entrants: list[tuple[TrainedModel, str | None, tuple[str, ...]]] = [
        (models["gp-baseline"], None, ()),
        (models["gp-word"], None, ()),
        (models["gp-baseline"], RULE, ()),
        (models[FINISH], None, registry.RECOMMENDED_WRAPPERS),
    ]
    jobs = [
        EpisodeConfig(
            robot=robot,
            cloth=cloth,
            seed=seed + k,
            model=model,
            made=made,
            decorators=around,
            disturbance=DISTURBANCE,
            images=k == 0,  # the first seed is pictured and filmed
        )
        for k in range(episodes)
        for model, made, around in entrants
    ]
    runs: dict[str, list[Episode]] = {job.source: [] for job in jobs}
    lost = []
    progress.phase(f"{robot}: placing and disturbance", items=len(jobs))
    with closing(run_episodes(jobs, workers=workers)) as results:
        for job, result in zip(jobs, results, strict=True):
            if isinstance(result, EpisodeFailure):
                lost.append(result)
                progress.advance(status=f"{job.source} seed {job.seed}: lost, {result.reason}")
                continue
            runs[job.source].append(result)
            progress.advance(status=f"{job.source} seed {job.seed}: {_words(result)}")
    return {name: tuple(group) for name, group in runs.items()}, lost


def _draw_frames(path: Path, results: RobotResults) -> None:
    """The first robot's best policy in two rows: placing; disturbance and repair."""
    run = pictured_run(results.runs[FINISHER])
    if run is None:  # its first episode was lost; the report says so
        return
    placing, repair = placing_steps(run), disturbance_steps(run)
    rows = [[placing[k] for k in (0, 3, 5, 7, 9)], [repair[k] for k in (2, 3, 4, 6, 9)] if repair else []]
    write_png(
        path,
        contact_sheet(
            [frame_strip(run, step_indices, results.draw, FRAME_WIDTH) for step_indices in rows if step_indices]
        ),
    )


def _words(episode: Episode) -> str:
    row = episode_metrics(episode)
    moments = [row["contact_placed"], row["contact_disturbed"], row["contact_final"]]
    return "contact " + " -> ".join("-" if c is None else f"{c:.2f}" for c in moments)


def _write_rows(out: Path, episodes: Sequence[Episode]) -> None:
    """episodes.csv and summary.json, anew after each robot, so that an interrupted demo leaves what it has."""
    rows = [episode_metrics(episode) for episode in episodes]
    write_text(out / "episodes.csv", pd.DataFrame(rows, columns=list(COLUMNS)).to_csv(index=False))
    groups = summary(rows).replace({np.nan: None}).to_dict(orient="records")
    write_json(out / "summary.json", {"episodes": rows, "groups": groups, "provenance": vars(capture_provenance())})
