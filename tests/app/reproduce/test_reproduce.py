"""A reproduction: what it plans, that it goes on where it stopped, and that its words follow from its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pandas as pd
import pytest

from layflat.app.evaluation.run import run_batch
from layflat.app.report.page import markdown
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.reproduce import inputs, run, studies
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.experiments import EXPERIMENTS
from layflat.app.reproduce.report import page_of, write_reports
from layflat.app.reproduce.studies import FULL, QUICK
from layflat.app.reproduce.trials import plan_of, trial_folder, trial_seconds
from layflat.app.support.errors import UsageError
from layflat.app.support.progress import Progress
from layflat.data.provenance import capture_provenance
from layflat.data.session.recorder import SessionRecorder
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy import registry
from layflat.policy.registry import TRAINABLE_POLICIES
from layflat.policy.trained_model import TrainedModel
from layflat.sim.robots.registry import ROBOTS
from layflat.tests.browser import measured, needs_chromium
from layflat.tests.fakeplay import Scripted


class Taught(ArtifactStore):
    """Models without demonstrations: one of each robot for everybody."""

    models: Mapping[str, TrainedModel] = MappingProxyType({})

    def model(self, taught):
        return self.models[taught.robot]


@pytest.fixture(scope="module")
def models(make_episode):
    return {
        robot: registry.train("nearest", [make_episode(robot=robot, source="scripted", disturbed=False)])
        for robot in ROBOTS
    }


@pytest.fixture(scope="module")
def ran(models, tmp_path_factory):
    """A folder with every trial of a small reproduction, by a bench that is none, and its size."""
    out = tmp_path_factory.mktemp("reproduction")
    workshop = Taught(out, seed=0)
    workshop.models = models
    size = replace(QUICK, seeds=2, sweep_seeds=1)
    for trial in run.trials_of(list(EXPERIMENTS.values()), size):
        run_batch(plan_of(trial, workshop, 0), trial_folder(out, trial), workers=2, play=Scripted())
    with ExperimentResults(out, size, workshop) as material:
        write_reports(out, material)
    return out, size, workshop


@pytest.mark.parametrize("size", [FULL, QUICK], ids=lambda size: size.name)
def test_every_experiment_can_be_planned(size):
    trials = run.trials_of(list(EXPERIMENTS.values()), size)
    by_name = {trial.name: trial for trial in trials}
    assert len(by_name) == len(trials)
    for experiment in EXPERIMENTS.values():
        wanted = experiment.trials(size)
        assert wanted, experiment.name
        assert all(by_name[trial.name] == trial for trial in wanted)
    assert {taught.policy for trial in trials for taught in trial.taught} <= set(TRAINABLE_POLICIES)
    assert trials[0].name.startswith("placing")
    assert size.demonstrations in size.counts


def test_the_full_size_is_what_was_asked_for():
    assert FULL.seeds >= 20
    assert FULL.counts == (1, 2, 3, 5, 7, 10, 15, 20)
    assert FULL.repeats == 2
    cloths = {trial.cloth for trial in EXPERIMENTS["disturbance"].trials(FULL)}
    assert cloths == {"towel", "napkin"}
    for experiment in EXPERIMENTS.values():
        robots = {trial.robot for trial in experiment.trials(FULL)}
        assert robots == ({"pickers"} if experiment.name == "flattening" else set(ROBOTS))


def test_quick_is_planned_for_under_fifteen_minutes_on_two_cores():
    trials = run.trials_of(list(EXPERIMENTS.values()), QUICK)
    assert sum(map(trial_seconds, trials)) / 2 < 11 * 60


def test_starts_and_demonstrations_share_no_seed(models, tmp_path):
    workshop = Taught(tmp_path, seed=0)
    workshop.models = models
    for trial in run.trials_of(list(EXPERIMENTS.values()), FULL):
        plan = plan_of(trial, workshop, 0)
        assert min(plan.seeds) >= studies.FIRST_SEED
        assert studies.FIRST_SEED > studies.DEMONSTRATION_SEED + 100
        assert len(plan.seeds) == trial.seeds


def test_a_folder_holds_one_reproduction(tmp_path):
    run._check_asked(tmp_path, QUICK, 0)
    run._check_asked(tmp_path, QUICK, 0)
    with pytest.raises(UsageError, match="holds a quick reproduction with 2 seeds from --seed 0"):
        run._check_asked(tmp_path, FULL, 0)
    with pytest.raises(UsageError, match="another --out"):
        run._check_asked(tmp_path, QUICK, 1)
    (tmp_path / run.ASKED).write_text("{}", encoding="utf-8")
    with pytest.raises(UsageError, match="no file of a reproduction"):
        run._check_asked(tmp_path, QUICK, 0)


def test_before_anything_was_run_the_page_says_so(tmp_path):
    with ExperimentResults(tmp_path, QUICK, ArtifactStore(tmp_path, seed=0)) as material:
        shown = [(experiment, experiment.show(material)) for experiment in EXPERIMENTS.values()]
        page = page_of(shown, QUICK, capture_provenance())
    text = markdown(page)
    for experiment in EXPERIMENTS.values():
        assert f"## {experiment.title}" in text
    assert {claim.holds for _, each in shown for claim in each.claims} == {"not run"}
    assert text.count("Not run yet") >= len(EXPERIMENTS)


def test_tables_are_the_means_of_the_episodes(ran):
    out, size, workshop = ran
    with ExperimentResults(out, size, workshop) as material:
        (trial,) = (trial for trial in studies.placing(size) if trial.robot == "hanger")
        results = material.results(trial)
    text = (out / "table.md").read_text(encoding="utf-8")
    section = (
        text.split("\n## Figures 4-4 and 4-5")[1].split("\n## ")[0].split("### hanger robot, towel")[1].split("### ")[0]
    )
    (line,) = (line for line in section.splitlines() if line.startswith(f"| {PROPOSED}, second disturbance"))
    rows = results.rows[(results.rows["policy"] == PROPOSED) & (results.rows["disturbance"] == "thesis")]
    assert len(rows) == size.seeds
    gains = []
    for row in rows["run"]:
        contact = results.episode(row).contact()
        assert len(contact) == 3 + 2 * 2 + 1
        gains.append(contact[7] - contact[6])
    cells = [cell.strip() for cell in line.split("|")]
    assert cells[2] == str(size.seeds)
    assert cells[6].startswith(f"{100 * np.mean(gains):+.1f}".replace("-", "\u2212"))
    assert (out / "report.html").stat().st_size > 100_000


@needs_chromium
@pytest.mark.parametrize("width", [1280, 800])
def test_a_browser_shows_all_of_it(ran, tmp_path, width):
    found = measured(ran[0] / "report.html", tmp_path, width)
    assert (found["overflow"], found["wide"], found["broken"]) == (0, 0, 0)
    assert width < 1280 or found["cut"] == 0


def test_a_part_of_it_can_be_asked_for(ran):
    assert [experiment.name for experiment in run.chosen(["field", "placing"])] == ["field", "placing"]
    with pytest.raises(UsageError, match="experiment 'nonsense' is unknown"):
        run.chosen(["nonsense"])


def _rows(effect: dict[str, float], rng: np.random.Generator) -> pd.DataFrame:
    """20 starts of each policy: ``effect`` on what is regained and on nothing else, over the noise of each start."""
    lines = []
    for seed in range(20):
        of_start = rng.normal(0.9, 0.02)
        for policy, gain in effect.items():
            for disturbance in ("none", "thesis", "tug"):
                lines.append(
                    {
                        "policy": policy, "robot": "hanger", "cloth": "towel", "seed": seed, "disturbance": disturbance,
                        "contact_final": of_start, "flat_area_final": of_start, "crashed": False, "unstable": False,
                        "regained_1": gain + rng.normal(0, 0.01) if disturbance == "thesis" else 0.05,
                        "regained_2": 0.05 if disturbance == "thesis" else np.nan,
                    }
                )  # fmt: skip
    return pd.DataFrame(lines)


def test_what_word_adds_is_said_where_the_numbers_show_it_and_only_there():
    helps = _rows({BASELINE: 0.0, "gp-contact": 0.1, "gp-direction": 0.05, PROPOSED: 0.2}, np.random.default_rng(0))
    said = list(inputs.what_word_adds({"hanger": helps}))
    assert "of 14 comparisons 2 show that it helps, 0 that it harms" in said[0]
    assert "regained, first, hanger robot, added to position and contact" in said[1]
    nothing = _rows({BASELINE: 0.0, "gp-contact": 0.1, "gp-direction": 0.0, PROPOSED: 0.1}, np.random.default_rng(1))
    said = list(inputs.what_word_adds({"hanger": nothing}))
    assert "0 show that it helps" in said[0]
    assert not any(line.startswith("It ") for line in said)
    assert any("is higher with gp-contact than with gp-baseline" in line for line in said)
    harms = _rows({BASELINE: 0.1, "gp-contact": 0.1, "gp-direction": 0.0, PROPOSED: 0.1}, np.random.default_rng(1))
    assert any(line.startswith("It harms in: regained") for line in inputs.what_word_adds({"hanger": harms}))


def test_models_learn_once_from_the_first_demonstrations_that_ended_flat(make_episode, tmp_path):
    workshop = ArtifactStore(tmp_path, seed=0)
    path = workshop.session_path("hanger", "towel")
    path.parent.mkdir()
    with SessionRecorder(path, robot="hanger", cloth="towel", descriptor=DEFAULT_DESCRIPTOR) as recorder:
        for seed, outcome in ((1003, "success"), (1000, "success"), (1001, "failure"), (1002, "success")):
            drawn = make_episode(
                source="scripted", seed=seed, disturbed=False, outcome=outcome, descriptor=DEFAULT_DESCRIPTOR
            )
            recorder.keep(drawn)
    assert [episode.seed for episode in workshop.demonstrations("hanger", "towel", 2)] == [1000, 1002]
    taught = studies.ModelSpec(policy="nearest", robot="hanger", cloth="towel", demonstrations=2)
    with Progress({"models": 1.0}) as progress:
        progress.phase("models")
        workshop.prepare([taught, taught], progress, workers=2)
        before = workshop.model_path(taught).stat().st_mtime_ns
        assert workshop.model(taught).demonstrations == 2
        workshop.prepare([taught], progress, workers=2)
    assert workshop.model_path(taught).stat().st_mtime_ns == before
    assert len(workshop.attempts("hanger", "towel")) == 4


@pytest.mark.slow
def test_the_same_command_goes_on_and_changes_nothing_that_is_there(tmp_path, capsys):
    def call() -> str:
        run.reproduce(tmp_path, quick=True, seeds=1, seed=5000, only=["flattening"], workers=2, report_only=False)
        return capsys.readouterr().out

    assert "report.html" in call()
    rows = (tmp_path / "trials" / "flattening" / "episodes.csv").read_bytes()
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "trials" / "flattening" / "runs").iterdir()}
    (tmp_path / "report.html").unlink()
    assert "report.html" in call()
    assert (tmp_path / "trials" / "flattening" / "episodes.csv").read_bytes() == rows
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "trials" / "flattening" / "runs").iterdir()} == files
    text = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert "| word | 1 |" in text
    with pytest.raises(UsageError, match="holds a quick reproduction with 1 seeds"):
        run.reproduce(tmp_path, quick=True, seeds=2, seed=5000, only=[], workers=1, report_only=True)
