"""`layflat evaluate` and `layflat disturb`: policies compared from the same starts, through the same disturbances."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import pandas as pd

from layflat.app.evaluation.local_engine import Engine, local_engine
from layflat.app.evaluation.paired import CONDITION
from layflat.app.evaluation.plan import EvaluationPlan, PolicySpec
from layflat.app.evaluation.ray_engine import ray_engine
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_batch
from layflat.app.evaluation.suites import cases_of
from layflat.app.report.comparison_sentences import paired_table
from layflat.app.report.evaluation_page import EXAMPLES, PageOptions, write_evaluation
from layflat.app.report.policies import policies_of
from layflat.app.report.result_tables import group_table
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.progress import Progress
from layflat.app.workers.make_policy import SCRIPTED
from layflat.policy import model_io as model_files
from layflat.policy.registry import BUILTIN_POLICIES, WRAPPERS
from layflat.policy.trained_model import TrainedModel
from layflat.sim.cloth.starts import Start
from layflat.sim.robots.registry import ROBOTS

EPISODE_S = 12.0
CASE_S = 6.0
REPORT_S = 15.0
"""Core-seconds of a placing, of what follows in each case, and of the page, for the first estimate of the time left."""
DEFAULT_CLOTH = "towel"
_SPEC = re.compile(r"(?:(?P<name>[^=/]+)=)?(?P<who>.+)")


def evaluate(
    policies: Sequence[str],
    *,
    out: Path,
    episodes: int,
    seed: int,
    disturb: Sequence[str],
    cloths: Sequence[str],
    robots: Sequence[str],
    start: Start,
    limit_s: float,
    workers: int,
    engine: str,
    address: str | None,
    force: bool,
    videos: bool = False,
) -> EvaluationResults:
    """Run ``policies`` from the starts of ``seed``, ``seed + 1``, ...; a table on stdout, all else in ``out``.

    A policy is ``[NAME=]MODEL.npz[+RULE][+DECORATOR...]``; the name of one that needs no training may be the model.
    """
    entrants = entrants_of(policies, robots)
    taught = dict.fromkeys(entrant.model.cloth for entrant in entrants if entrant.model is not None)
    plan = EvaluationPlan(
        entrants=entrants,
        cloths=tuple(cloths or taught or [DEFAULT_CLOTH]),
        seeds=tuple(seed + k for k in range(episodes)),
        cases=tuple(case for what in disturb for case in cases_of(what)),
        start=start,
        limit_s=limit_s,
    )
    on = engine_of(engine, workers, address)
    seconds = len(plan.seeds) * len(plan.cloths) * len(entrants) * (EPISODE_S + CASE_S * len(plan.cases))
    with Progress({"episodes": seconds / workers, "report": REPORT_S}) as progress:
        progress.phase("episodes", items=plan.episodes)
        results = run_batch(plan, out, engine=on, force=force, progress=progress)
        progress.phase("report")
        options = PageOptions(videos=EXAMPLES if videos else ())
        page = write_evaluation(results, options, on_progress=progress.status)
    show(results.rows)
    print(f"results: {out}")
    print(f"report: {page}")
    if results.rows["crashed"].all():
        raise LayflatError(f"every episode crashed; the first: {results.rows['reason'].iloc[0]}")
    return results


def engine_of(name: str, workers: int, address: str | None) -> Engine:
    if name == "local":
        if address is not None:
            raise UsageError("--address is where a Ray cluster is; give --engine ray with it")
        return local_engine(workers)
    if name == "ray":
        return ray_engine(workers, address)
    raise UsageError(f"engine {name!r} is unknown; known ones are local, ray")


@dataclass(frozen=True)
class ParsedPolicy:
    """One policy of the command line, taken apart."""

    name: str | None
    stem: str
    model: TrainedModel | None
    made: str | None

    decorators: tuple[str, ...] = ()

    @property
    def usual_name(self) -> str:
        who = [None if self.model is None else self.model.policy, self.made, *self.decorators]
        return "+".join(name for name in who if name is not None)


def entrants_of(policies: Sequence[str], robots: Sequence[str]) -> tuple[PolicySpec, ...]:
    """One entrant for each policy and robot; those whose usual names are the same are told apart by their files."""
    given = [_given(text) for text in policies]
    taught = dict.fromkeys(one.model.layout.robot.name for one in given if one.model is not None)
    wanted = tuple(
        robot for robot in ROBOTS if robot in [validators.one_of("robot", name, ROBOTS) for name in robots or taught]
    )
    if not wanted:
        raise UsageError("a policy without a model can do any robot; give --robot hanger or --robot pickers")
    found = [
        (robot, one) for robot in wanted for one in given if one.model is None or one.model.layout.robot.name == robot
    ]
    left_out = [one for one in given if one.model is not None and one.model.layout.robot.name not in wanted]
    if left_out:
        raise UsageError(f"{left_out[0].stem} was taught another robot than {', '.join(wanted)}; leave it out")
    usual = [(robot, one.name or one.usual_name) for robot, one in found]
    return tuple(
        PolicySpec(
            name=f"{name}@{_plain(one.stem)}" if one.name is None and usual.count((robot, name)) > 1 else name,
            robot=robot,
            model=one.model,
            made=one.made,
            decorators=one.decorators,
        )
        for (robot, one), (_, name) in zip(found, usual, strict=True)
    )


def _given(text: str) -> ParsedPolicy:
    if text in (*BUILTIN_POLICIES, SCRIPTED):  # even where a file has that name
        return ParsedPolicy(None, text, None, text)
    if Path(text).exists():
        return ParsedPolicy(None, Path(text).stem, _load(Path(text)), None)
    parts = _SPEC.fullmatch(text)
    name, (who, *around) = (None, [text]) if parts is None else (parts["name"], _taken_apart(parts["who"]))
    decorators = tuple(word for word in around if word in WRAPPERS)
    rule = next((word for word in around if word in BUILTIN_POLICIES), None)
    if around != [*([rule] if rule else ()), *decorators]:
        raise UsageError(f"policy {text!r}: after the model one rule may come, and then what is around both")
    if who in (*BUILTIN_POLICIES, SCRIPTED) and rule is None:
        return ParsedPolicy(name, who, None, who, decorators)
    if Path(who).suffix != ".npz":
        known = ", ".join((*BUILTIN_POLICIES, SCRIPTED))
        raise UsageError(f"policy {text!r} is neither a model's file (MODEL.npz) nor one of {known}")
    return ParsedPolicy(name, Path(who).stem, _load(Path(who)), rule, decorators)


def _taken_apart(text: str) -> list[str]:
    """Who decides, and the known words behind it: of a file's name only its end can be one."""
    words: list[str] = []
    while True:
        who, plus, word = text.rpartition("+")
        if not plus or word not in (*BUILTIN_POLICIES, *WRAPPERS):
            return [text, *words]
        text, words = who, [word, *words]


def _load(path: Path) -> TrainedModel:
    return model_files.load(validators.readable_file(path, "a model that `layflat train` wrote"))


def _plain(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9.]+", "-", stem).strip("-")


def show(rows: pd.DataFrame) -> None:
    """Print one line for each policy and one for each difference, for every condition, on stdout."""
    for key, part in rows.groupby(list(CONDITION), sort=False):
        groups, policies = group_table(part), policies_of(part)
        print_table(groups.header, groups.rows, title=", ".join(key), left=1, width=200)
        pairs = paired_table(part, [(b, a) for a, b in combinations(policies, 2)])
        if pairs.rows:
            print_table(pairs.header, pairs.rows, left=2, width=200)
