"""A reproduction: its plan, that it continues where it stopped, and that its words follow from its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pandas as pd
import pytest

from layflat.app.evaluation.run import run_evaluation
from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.report.page import markdown
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.reproduce import run, studies
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.claims import NO, PART, YES, agrees_by_share, agrees_by_value, too_few
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.experiments import EXPERIMENTS
from layflat.app.reproduce.inputs import word_contribution
from layflat.app.reproduce.report import page_of, write_reports
from layflat.app.reproduce.studies import FULL, QUICK
from layflat.app.reproduce.trials import expected_core_s, plan_of, results_of, trial_folder
from layflat.app.support.errors import UsageError
from layflat.app.support.progress import Progress
from layflat.data.provenance import capture_provenance
from layflat.data.session.recorder import SessionRecorder
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy import registry
from layflat.policy.registry import TRAINABLE_POLICIES
from layflat.policy.trained_model import TrainedModel
from layflat.sim.robots.registry import THESIS_ROBOTS, robot_spec
from layflat.tests.app.fake_episodes import FakeEpisodes
from layflat.tests.browser import measured, needs_chromium

ALL = list(EXPERIMENTS.values())


class FakeStore(ArtifactStore):
    """Models without demonstrations: one of each robot for every policy."""

    models: Mapping[str, TrainedModel] = MappingProxyType({})

    def model(self, spec):
        return self.models[spec.robot]


@pytest.fixture(scope="module")
def models(make_episode):
    return {
        robot: registry.train("nearest", [make_episode(robot=robot, source="scripted", disturbed=False)])
        for robot in THESIS_ROBOTS
    }


@pytest.fixture(scope="module")
def reproduced(models, tmp_path_factory):
    """A folder with every trial of a small reproduction, without physics, and its scale and store."""
    out = tmp_path_factory.mktemp("reproduction")
    store = FakeStore(out, seed=0)
    store.models = models
    scale = replace(QUICK, seeds=2, sweep_seeds=1)
    for trial in run.trials_of(ALL, scale):
        run_evaluation(plan_of(trial, store, 0), trial_folder(out, trial), workers=2, make=FakeEpisodes())
    with EpisodeRenderer() as renderer:
        write_reports(out, ExperimentResults(out, scale, store, renderer))
    return out, scale, store


@pytest.mark.parametrize("scale", [FULL, QUICK], ids=lambda scale: scale.name)
def test_every_experiment_can_be_planned(scale):
    trials = run.trials_of(ALL, scale)
    by_name = {trial.name: trial for trial in trials}
    assert len(by_name) == len(trials)
    for experiment in ALL:
        wanted = experiment.plan(scale)
        assert wanted, experiment.name
        assert all(by_name[trial.name] == trial for trial in wanted)
    assert {spec.policy for trial in trials for spec in trial.models} <= set(TRAINABLE_POLICIES)
    assert trials[0].name.startswith("placing")
    assert scale.demonstrations in scale.counts


def test_the_full_scale_is_that_of_the_thesis_or_more():
    assert FULL.seeds >= 20
    assert FULL.counts == (1, 2, 3, 5, 7, 10, 15, 20)
    assert FULL.repeats == 2
    assert {trial.cloth for trial in EXPERIMENTS["disturbance"].plan(FULL)} == {"towel", "napkin"}
    for experiment in ALL:
        robots = {trial.robot for trial in experiment.plan(FULL)}
        assert robots == ({"pickers"} if experiment.name == "flattening" else set(THESIS_ROBOTS))


def test_quick_takes_under_fifteen_minutes_on_two_cores():
    assert sum(map(expected_core_s, run.trials_of(ALL, QUICK))) / 2 < 11 * 60


def test_starts_and_demonstrations_share_no_seed(models, tmp_path):
    store = FakeStore(tmp_path, seed=0)
    store.models = models
    assert studies.FIRST_SEED > studies.DEMONSTRATION_SEED + 100
    for trial in run.trials_of(ALL, FULL):
        plan = plan_of(trial, store, 0)
        assert min(plan.seeds) >= studies.FIRST_SEED
        assert len(plan.seeds) == trial.seeds


def test_a_folder_holds_one_reproduction(tmp_path):
    run.check_config(tmp_path, QUICK, 0)
    run.check_config(tmp_path, QUICK, 0)
    for scale, seed in ((FULL, 0), (QUICK, 1)):
        with pytest.raises(UsageError, match=r"holds a quick reproduction with 2 seeds from --seed 0.*another --out"):
            run.check_config(tmp_path, scale, seed)
    (tmp_path / run.CONFIG).write_text("{}", encoding="utf-8")
    with pytest.raises(UsageError, match="no file of a reproduction"):
        run.check_config(tmp_path, QUICK, 0)


def test_before_anything_was_run_the_page_says_so(tmp_path):
    with EpisodeRenderer() as renderer:
        results = ExperimentResults(tmp_path, QUICK, ArtifactStore(tmp_path, seed=0), renderer)
        outputs = [(experiment, experiment.render(results)) for experiment in ALL]
        text = markdown(page_of(outputs, QUICK, capture_provenance()))
    for experiment in ALL:
        assert f"## {experiment.title}" in text
    assert {claim.agrees for _, output in outputs for claim in output.claims} == {"not run"}
    assert text.count("Not run yet") >= len(ALL)


def test_tables_are_the_means_of_the_episodes(reproduced):
    out, scale, _ = reproduced
    (trial,) = (trial for trial in studies.placing(scale) if trial.robot == "hanger")
    results = results_of(trial, out)
    text = (out / "table.md").read_text(encoding="utf-8")
    section = text.split("\n## Figures 4-4 and 4-5")[1].split("\n## ")[0]
    table = section.split("### hanger robot, towel")[1].split("### ")[0]
    (line,) = (line for line in table.splitlines() if line.startswith(f"| {PROPOSED}, second disturbance"))
    rows = results.rows[(results.rows["policy"] == PROPOSED) & (results.rows["disturbance"] == "thesis")]
    assert len(rows) == scale.seeds
    gains = []
    for name in rows["run"]:
        contact = results.episode(name).contact()
        assert len(contact) == 3 + 2 * 2 + 1
        gains.append(contact[7] - contact[6])
    cells = [cell.strip() for cell in line.split("|")]
    assert cells[2] == str(scale.seeds)
    assert cells[6].startswith(f"{100 * np.mean(gains):+.1f}".replace("-", "\u2212"))
    assert (out / "report.html").stat().st_size > 100_000


def test_every_experiment_has_its_tables_in_the_page(reproduced):
    text = (reproduced[0] / "table.md").read_text(encoding="utf-8")
    tables = {part.split("\n")[0]: part.count("| --- |") for part in text.split("\n## ")[1:]}
    expected = {"placing": 2, "disturbance": 4, "bad-contact": 2, "folded-corner": 2, "inputs": 4, "flattening": 1}
    expected |= {"counts": 2, "cloths": 4, "comparators": 2, "field": 0}
    assert {e.name: tables[e.title] for e in ALL} == expected
    assert "in part" in text or "too few to say" in text
    assert tables["What agrees, and what does not"]


@needs_chromium
@pytest.mark.parametrize("width", [1280, 800])
def test_a_browser_shows_all_of_it(reproduced, tmp_path, width):
    found = measured(reproduced[0] / "report.html", tmp_path, width)
    assert (found["overflow"], found["wide"], found["broken"]) == (0, 0, 0)
    assert width < 1280 or found["cut"] == 0


def test_an_unknown_experiment_is_refused(tmp_path):
    with pytest.raises(UsageError, match="experiment 'nonsense' is unknown"):
        run.reproduce(
            run.ReproduceConfig(out=tmp_path, quick=True, seeds=1, seed=0, only=("nonsense",), report_only=True),
            workers=1,
        )
    assert not list(tmp_path.iterdir())


def test_claims_agree_by_interval_by_range_and_by_share():
    found = np.linspace(0.90, 1.00, 20)
    assert [agrees_by_value(stated, found) for stated in (0.95, 0.91, 0.5)] == [YES, PART, NO]
    assert [agrees_by_share(n, 10) for n in (9, 5, 4)] == [YES, PART, NO]
    assert [too_few(found[:n]) for n in (0, 5, 6)] == ["not run", "too few to say", None]


def _rows(effect: dict[str, float], rng: np.random.Generator) -> pd.DataFrame:
    """20 starts of each policy: ``effect`` on what is regained and on nothing else, over the noise of each start."""
    lines = []
    for seed in range(20):
        of_start = rng.normal(0.9, 0.02)
        for policy, gain in effect.items():
            for disturbance in ("none", "thesis", "tug"):
                lines.append(
                    {
                        "policy": policy, "robot": "hanger", "task": "place", "cloth": "towel", "physics": "bullet",
                        "seed": seed, "disturbance": disturbance,
                        "contact_final": of_start, "flat_area_final": of_start, "crashed": False, "unstable": False,
                        "regained_1": gain + rng.normal(0, 0.01) if disturbance == "thesis" else 0.05,
                        "regained_2": 0.05 if disturbance == "thesis" else np.nan,
                    }
                )  # fmt: skip
    return pd.DataFrame(lines)


def test_the_contribution_of_word_is_claimed_only_where_the_numbers_show_it():
    def sentences(seed: int, **effect: float) -> list[str]:
        policies = {"baseline": BASELINE, "contact": "gp-contact", "direction": "gp-direction", "proposed": PROPOSED}
        rows = _rows({policies[name]: gain for name, gain in effect.items()}, np.random.default_rng(seed))
        return list(word_contribution({"hanger": rows}))

    helps = sentences(0, baseline=0.0, contact=0.1, direction=0.05, proposed=0.2)
    assert "of 14 comparisons 2 show that it helps, 0 that it harms" in helps[0]
    assert "regained, first, hanger robot, added to position and contact" in helps[1]
    nothing = sentences(1, baseline=0.0, contact=0.1, direction=0.0, proposed=0.1)
    assert "0 show that it helps" in nothing[0]
    assert not any(line.startswith("It ") for line in nothing)
    assert any("is higher with gp-contact than with gp-baseline" in line for line in nothing)
    harms = sentences(1, baseline=0.1, contact=0.1, direction=0.0, proposed=0.1)
    assert any(line.startswith("It harms in: regained") for line in harms)


def test_models_learn_once_from_the_first_demonstrations_that_ended_flat(make_episode, tmp_path):
    store = ArtifactStore(tmp_path, seed=0)
    path = store.session_path("hanger", "towel")
    path.parent.mkdir()
    with SessionRecorder(path, robot=robot_spec("hanger"), cloth="towel", descriptor=DEFAULT_DESCRIPTOR) as recorder:
        for seed, outcome in ((1003, "success"), (1000, "success"), (1001, "failure"), (1002, "success")):
            episode = make_episode(source="scripted", seed=seed, disturbed=False, outcome=outcome)
            recorder.save(replace(episode, descriptor=DEFAULT_DESCRIPTOR))
    assert [episode.seed for episode in store.demonstrations("hanger", "towel", 2)] == [1000, 1002]
    spec = studies.ModelSpec(policy="nearest", robot="hanger", cloth="towel", demonstrations=2)
    with Progress({"models": 1.0}) as progress:
        progress.phase("models")
        store.build([spec, spec], progress, workers=2)
        before = store.model_path(spec).stat().st_mtime_ns
        assert store.model(spec).demonstrations == 2
        store.build([spec], progress, workers=2)
    assert store.model_path(spec).stat().st_mtime_ns == before
    assert len(store.attempts("hanger", "towel")) == 4


@pytest.mark.slow
def test_the_same_command_continues_and_changes_nothing_that_is_there(tmp_path, capsys):
    def call() -> str:
        run.reproduce(
            run.ReproduceConfig(out=tmp_path, quick=True, seeds=1, seed=5000, only=("flattening",), report_only=False),
            workers=2,
        )
        return capsys.readouterr().out

    folder = tmp_path / "trials" / "flattening"
    assert "report.html" in call()
    rows = (folder / "episodes.csv").read_bytes()
    files = {path: path.stat().st_mtime_ns for path in (folder / "runs").iterdir()}
    (tmp_path / "report.html").unlink()
    assert "report.html" in call()
    assert (folder / "episodes.csv").read_bytes() == rows
    assert {path: path.stat().st_mtime_ns for path in (folder / "runs").iterdir()} == files
    assert "| word | 1 |" in (tmp_path / "table.md").read_text(encoding="utf-8")
    with pytest.raises(UsageError, match="holds a quick reproduction with 1 seeds"):
        run.reproduce(
            run.ReproduceConfig(out=tmp_path, quick=True, seeds=2, seed=5000, only=(), report_only=True), workers=1
        )
