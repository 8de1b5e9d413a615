"""`layflat station` and `--station`: a real robot and camera, and their digital twin."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.commands.evaluate import print_results
from layflat.app.commands.station_calibrate import ask, closing_arm
from layflat.app.commands.train import successful_demonstrations
from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.run import folder_lock, run_evaluation
from layflat.app.evaluation.suites import cases_of
from layflat.app.hardware.franka_arm import FrankaArm
from layflat.app.hardware.readiness import STEPS, Reading, measure
from layflat.app.hardware.realsense_camera import open_camera
from layflat.app.hardware.station_config import RobotConfig, StationConfig, read_station
from layflat.app.hardware.station_environment import StationEnvironment
from layflat.app.hardware.station_episode import PolicyMaker, run_station_episode, station_engine, write_commands
from layflat.app.hardware.twin.twin import Twin
from layflat.app.report.blocks import Page, Section, Table, TableBlock
from layflat.app.report.evaluation_page import PageOptions, write_evaluation
from layflat.app.report.page import write_page
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import LayflatError, say
from layflat.app.support.formatting import MISSING
from layflat.app.support.metrics import episode_metrics, write_json
from layflat.app.support.progress import Progress
from layflat.app.support.seeds import EVALUATION_SEED
from layflat.app.support.session_lines import kept_line
from layflat.app.workers.work_item import NO_DISTURBANCE, DisturbanceCase
from layflat.data.provenance import capture_provenance
from layflat.data.session.environment_recorder import recorder_for
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io, registry
from layflat.policy.registry import RECOMMENDED_WRAPPERS
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.robots.hanger import PandaHanger

FINISH = "gp-finish"
DEMONSTRATION_S, TRAINING_S, EPISODE_S = 20.0, 20.0, 18.0
HEADER = ("quantity", "measured", "limit", "")
GOOD = {True: "good", False: "too much"}
TWIN = "twin"
"""Name of a station that is none: its digital twin."""


@dataclass(frozen=True, kw_only=True)
class TwinConfig:
    """Settings of one `layflat station twin` call."""

    out: Path
    policy: str | None = None
    """POLICY text; None: `gp-finish` with its wrappers, taught on the twin itself."""
    demonstrations: int = 5
    episodes: int = 3
    seed: int = EVALUATION_SEED
    cloth: str = DEFAULT_CLOTH
    disturb: tuple[str, ...] = ("thesis",)


def twin(config: TwinConfig, *, force: bool) -> None:
    """Teach, place, disturb and repair on the digital twin; write what `layflat evaluate` writes."""
    station = StationConfig(robot=RobotConfig(host=TWIN), cloth=config.cloth)
    seconds = {"demonstrations": DEMONSTRATION_S * config.demonstrations, "training": TRAINING_S}
    cases = tuple(case for text in config.disturb for case in cases_of(text))
    seconds["episodes"] = EPISODE_S * config.episodes * (1 + 2 * len(cases))
    with folder_lock(config.out), Progress(seconds) as progress, Twin(station) as running:
        policy = _policy(config, running.env, progress)
        plan = EvaluationPlan(
            policies=(policy,),
            robots=(PandaHanger.spec.name,),
            cloths=(config.cloth,),
            seeds=tuple(config.seed + k for k in range(config.episodes)),
            cases=cases,
        )
        progress.phase("episodes", items=plan.n_episodes)
        results = run_evaluation(
            plan, config.out, engine=station_engine(running.env), force=force, progress=progress, locked=True
        )
        page = write_evaluation(results, PageOptions(films=0))
    print_results(results.rows)
    print(f"results: {config.out}")
    print(f"report: {page}")


def _policy(config: TwinConfig, env: StationEnvironment, progress: Progress) -> PolicySpec:
    """Return the policy to place with; without one, record demonstrations on the twin and train."""
    if config.policy is not None:
        return PolicySpec.parse(config.policy)
    session, model = config.out / "demonstrations.h5", config.out / "model.npz"
    there = 0
    if session.exists():
        with open_session(session) as opened:
            there = len(opened)
    progress.phase("demonstrations", items=config.demonstrations)
    progress.skip(min(there, config.demonstrations), "already there")
    with recorder_for(session, env.spec) as recorder:
        for seed in range(there, config.demonstrations):
            _record_one(env, recorder, PolicySpec(builtin=SCRIPTED), seed, NO_DISTURBANCE, progress.note)
            progress.advance()
    progress.phase("training")
    trained = registry.train(FINISH, successful_demonstrations(session), provenance=capture_provenance())
    model_io.save(trained, model, force=True)
    return PolicySpec(model=trained, wrappers=RECOMMENDED_WRAPPERS, stem=model.stem)


@dataclass(frozen=True, kw_only=True)
class CheckConfig:
    """Settings of one `layflat station check` call."""

    station: Path
    out: Path | None = None
    steps: int = STEPS


def check(config: CheckConfig, *, force: bool) -> int:
    """Measure a station at rest, and say whether it is ready; status 1 where it is not."""
    page = None if config.out is None else validators.writable_file(config.out, suffix=".html", force=force)
    with _station(config.station) as env, env.idle():
        readings = measure(env, steps=config.steps)
    rows = [_row(reading) for reading in readings]
    print_table(HEADER, rows, left=1)
    ready = all(reading.good for reading in readings)
    verdict = "ready" if ready else "not ready"
    print(f"the station is {verdict}")
    if page is not None:
        _write_check(page, config.station, verdict, rows)
        print(f"page: {page}")
    return 0 if ready else 1


def _row(reading: Reading) -> list[str]:
    limited = reading.limit is not None
    limit, verdict = (f"{reading.limit:g} {reading.unit}", GOOD[reading.good]) if limited else (MISSING, "")
    return [reading.name, f"{reading.value:.3g} {reading.unit}", limit, verdict]


def _write_check(page: Path, station: Path, verdict: str, rows: list[list[str]]) -> None:
    table = TableBlock(table=Table(header=HEADER, rows=tuple(map(tuple, rows))))
    section = Section(id="readings", title="Readings", blocks=(table,))
    lead = f"{station.stem}, with the arm at rest. A limit is the most that a policy copes with."
    made = capture_provenance()
    lines = (f"{made.created_utc}, {made.platform}", made.command)
    write_page(page, Page(title=f"The station is {verdict}", lead=lead, sections=(section,), provenance=lines))


@contextmanager
def _station(
    path: Path, *, slow: float = 1.0, ready: Callable[[str], None] | None = None
) -> Iterator[StationEnvironment]:
    """Open the station of a file, or the twin where ``path`` is its name."""
    if str(path) == TWIN:
        with Twin(slow=slow) as running:
            yield running.env
        return
    config = read_station(path)
    camera = open_camera(config.camera)
    with ExitStack() as stack:
        stack.callback(camera.close)
        arm = stack.enter_context(closing_arm(FrankaArm(config.robot)))
        arm.start_control()
        yield StationEnvironment(config, arm, camera, slow=slow, ready=ready or ask)


def _dry_run(env: StationEnvironment, *, yes: bool) -> None:
    """Say where the arm will go, and ask."""
    if env.scene is not None or yes:
        return
    robot = env.config.robot
    here, home = np.round(env.arm.position(), 3).tolist(), np.round(env.home(), 3).tolist()
    say(
        f"the arm goes straight from {here} to {home} m and stays within {list(robot.workspace_low_m)} to "
        f"{list(robot.workspace_high_m)}, at most at {robot.speed_m_s:g} m/s and with {robot.force_n:g} N"
    )
    ask("clear that space and have the stop button at hand")


@dataclass(frozen=True, kw_only=True)
class StationRun:
    """Episodes of a policy, or of a person, on a station."""

    station: Path
    policy: PolicyMaker
    seeds: tuple[int, ...]
    case: DisturbanceCase = NO_DISTURBANCE
    record: Path | None = None
    images: bool = False
    json: Path | None = None
    slow: float = 1.0
    yes: bool = False


def run_on_station(run: StationRun) -> list[dict[str, Any]]:
    """Run the episodes one after another; each is durable when its line is printed. Return their rows.

    A fault stops the arm and keeps the episode as partial; then the run ends with that sentence and status 1.
    """
    rows: list[dict[str, Any]] = []
    with ExitStack() as stack:
        env = stack.enter_context(_station(run.station, slow=run.slow))
        _dry_run(env, yes=run.yes)
        recorder = (
            None
            if run.record is None
            else stack.enter_context(recorder_for(run.record, env.spec, save_images=run.images))
        )
        reason = None
        for seed in run.seeds:
            row, reason = _record_one(env, recorder, run.policy, seed, run.case, lambda line: print(line, flush=True))
            rows.append(row)
            if run.json is not None:
                write_json(run.json, {"episodes": rows, "provenance": vars(capture_provenance())})
            if reason is not None:
                break
    if reason is not None:
        raise LayflatError(f"{reason}; the episode is kept as partial")
    return rows


def _record_one(
    env: StationEnvironment,
    recorder: SessionRecorder | None,
    policy: PolicyMaker,
    seed: int,
    case: DisturbanceCase,
    show: Callable[[str], None],
) -> tuple[dict[str, Any], str | None]:
    """Run an episode, durable in the recorder's session; return its row, and why it is partial."""
    if recorder is None:
        episode, reason = run_station_episode(env, policy, seed, case)
        return episode_metrics(episode), reason
    writers: list[Any] = []

    def start(beginning: Any) -> Any:
        writers.append(recorder.start(replace(beginning, source=policy.label)))
        return writers[-1]

    episode, reason = run_station_episode(env, policy, seed, case, keep_images=recorder.save_images, on_start=start)
    saved = writers[-1].save(episode)
    write_commands(recorder.path.with_name(f"{recorder.path.stem}.{saved.name}.commands.json"), env)
    show(kept_line(saved))
    return episode_metrics(episode), reason
