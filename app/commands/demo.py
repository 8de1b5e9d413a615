"""`layflat demo`: record demonstrations, train policies on them, evaluate the policies, and report.

DIR holds the demonstrations, the models and an evaluation. The same command continues an interrupted demo.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from layflat.app.evaluation.plan import EvaluationPlan, plan_policies
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import clear, folder_lock, run_evaluation
from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.media.frames import contact_sheet, disturbance_steps, placing_steps
from layflat.app.media.png import write_png
from layflat.app.report.attractor_field import field_figure
from layflat.app.report.blocks import Block, Section, Text
from layflat.app.report.evaluation_page import PageOptions, write_evaluation
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.studies import RULE, ModelSpec
from layflat.app.support.errors import UsageError
from layflat.app.support.progress import Progress
from layflat.app.workers.sim_options import sim_config
from layflat.app.workers.work_item import DisturbanceCase
from layflat.policy.registry import RECOMMENDED_WRAPPERS
from layflat.policy.schedule import ScheduledDisturbance
from layflat.policy.trained_model import RegressionModel
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import THESIS_ROBOTS

DEMONSTRATIONS = 10
"""As many as the thesis gave its robot (chapter 4-3-2)."""
DISTURBANCE = "thesis"
"""Once in an episode, unlike in the suite of that name: the demo has five minutes on two cores."""
FINISH = "gp-finish"
TRAINED = (BASELINE, PROPOSED, FINISH)
FINISHER = "+".join((FINISH, *RECOMMENDED_WRAPPERS))
"""The policy that goes past the thesis's."""
DEMONSTRATION_S, TRAINING_S, EPISODE_S, REPORT_S = 12.0, 20.0, 16.0, 40.0
"""Core-seconds of a demonstration, a model, an episode with its disturbances, and the page, for the first estimate."""
TITLE = "Layflat: a cloth laid flat by a learned policy"
FRAME_WIDTH = 300
PLACING_FRAMES, REPAIR_FRAMES = (0, 3, 5, 7, 9), (2, 3, 4, 6, 9)
"""Moments of placing_steps and disturbance_steps that frames.png shows."""


@dataclass(frozen=True, kw_only=True)
class DemoConfig:
    """Settings of one `layflat demo` call."""

    out: Path
    episodes: int = 5
    seed: int = 0
    robots: tuple[str, ...] = THESIS_ROBOTS
    cloth: str = DEFAULT_CLOTH
    settings: tuple[str, ...] = ()
    """Conditions, KEY=VALUE."""


def run_demo(config: DemoConfig, *, workers: int, force: bool) -> Path:
    """Run the demo and print where the report is; return the report's path."""
    out = config.out
    for robot in config.robots:
        sim_config(config.settings, robot=robot, cloth=config.cloth)
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out} is not a folder; give another --out")
    with folder_lock(out):
        return _run_demo(config, workers, force=force)


def _run_demo(config: DemoConfig, workers: int, *, force: bool) -> Path:
    out, robots, cloth, seed = config.out, config.robots, config.cloth, config.seed
    report = out / "report.html"
    if report.exists() and not force:
        raise UsageError(f"{report} exists; give --force to replace it, or another --out")
    store = ArtifactStore(out, seed=seed, conditions=config.settings)
    if force:
        clear_demo(out, store, robots, cloth)
    with Progress(_phases(robots, config.episodes, workers)) as progress:
        for robot in robots:
            progress.phase(f"{robot}: demonstrations", items=DEMONSTRATIONS)
            store.record(robot, cloth, DEMONSTRATIONS, progress, workers=workers)
            progress.phase(f"{robot}: training", items=len(TRAINED))
            store.train(model_specs(robot, cloth), progress, workers=workers)
        plan = plan_of(store, robots, cloth, range(seed, seed + config.episodes), config.settings)
        progress.phase("evaluation", items=plan.n_episodes)
        results = run_evaluation(plan, out, workers=workers, progress=progress, locked=True)
        progress.phase("report")
        _write_frames(out / "frames.png", results, robots[0])
        sections = (_field_section(store, results.rows, robots, cloth),)
        options = PageOptions(title=TITLE, thesis_tables=True, first=FINISHER, sections=sections)
        write_evaluation(results, options, on_progress=progress.advance)
    print(f"report: {report}")
    return report


def model_specs(robot: str, cloth: str) -> list[ModelSpec]:
    """Return the models of a robot."""
    return [ModelSpec(policy=policy, robot=robot, cloth=cloth, demonstrations=DEMONSTRATIONS) for policy in TRAINED]


def plan_of(
    store: ArtifactStore, robots: Sequence[str], cloth: str, seeds: Sequence[int], conditions: tuple[str, ...] = ()
) -> EvaluationPlan:
    """Return the evaluation: the trained policies, and the baseline with a rule that repairs."""
    policies: list[str] = []
    for robot in robots:
        baseline, proposed, finish = (str(store.model_path(spec).resolve()) for spec in model_specs(robot, cloth))
        policies += [baseline, proposed, f"{baseline}+{RULE}", "+".join((finish, *RECOMMENDED_WRAPPERS))]
    specs, wanted = plan_policies(policies, robots)
    case = DisturbanceCase(name=DISTURBANCE, schedule=(ScheduledDisturbance(disturbance=DISTURBANCES[DISTURBANCE]),))
    return EvaluationPlan(
        policies=specs, robots=wanted, cloths=(cloth,), seeds=tuple(seeds), cases=(case,), settings=conditions
    )


def clear_demo(out: Path, store: ArtifactStore, robots: Sequence[str], cloth: str) -> None:
    """Remove what an earlier demo wrote, and nothing else."""
    clear(out)
    (out / "frames.png").unlink(missing_ok=True)
    for robot in robots:
        session = store.session_path(robot, cloth)
        for path in (session, *(store.model_path(spec) for spec in model_specs(robot, cloth))):
            path.unlink(missing_ok=True)
        shutil.rmtree(session.with_name(f"{session.name}.parts"), ignore_errors=True)


def _phases(robots: Sequence[str], episodes: int, workers: int) -> dict[str, float]:
    phases: dict[str, float] = {}
    for robot in robots:
        phases[f"{robot}: demonstrations"] = DEMONSTRATION_S * DEMONSTRATIONS / workers
        phases[f"{robot}: training"] = TRAINING_S * len(TRAINED) / workers
    evaluation_s = EPISODE_S * episodes * len(robots) * (len(TRAINED) + 1) / workers
    return phases | {"evaluation": evaluation_s, "report": REPORT_S}


def _field_section(store: ArtifactStore, rows: pd.DataFrame, robots: Sequence[str], cloth: str) -> Section:
    """Show the fields of the thesis's models, also for a disturbed cloth; gp-finish has the same field as gp-word."""

    def blocks() -> Iterator[Block]:
        for robot in robots:
            trained = {spec.policy: store.model(spec) for spec in model_specs(robot, cloth)[:2]}
            models = {name: model for name, model in trained.items() if isinstance(model, RegressionModel)}
            recorded, learned = store.attempts(robot, cloth), store.demonstrations(robot, cloth, DEMONSTRATIONS)
            line = f"{robot}: {len(recorded)} demonstrations were recorded; {len(learned)} that ended flat are learned."
            yield Text(lines=(line,))
            disturbed = rows.loc[rows["robot"] == robot, "contact_disturbed"].astype(float).mean()
            yield field_figure(models, learned, contact=None if pd.isna(disturbed) else float(disturbed))

    return Section(id="field", title="Learned attractor fields", short="Fields", blocks=tuple(blocks()))


def _write_frames(path: Path, results: EvaluationResults, robot: str) -> None:
    """Draw the first disturbed episode of FINISHER in two rows: placing; disturbance and repair."""
    rows = results.rows
    mine = rows[(rows["policy"] == FINISHER) & (rows["robot"] == robot) & (rows["disturbance"] == DISTURBANCE)]
    mine = mine[~mine["crashed"]]
    if mine.empty:  # the page says what was lost
        return
    episode = results.episode(mine["run"].iloc[0])
    placing, repair = placing_steps(episode), disturbance_steps(episode)
    steps = [[placing[k] for k in PLACING_FRAMES], [repair[k] for k in REPAIR_FRAMES] if repair else []]
    with EpisodeRenderer() as renderer:
        strips = [strip for row in steps if (strip := renderer.frame_strip(episode, row, FRAME_WIDTH))]
    if strips:
        write_png(path, contact_sheet(strips))
