"""`layflat train` from a recorded file to a model that loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.app.cli import main
from layflat.app.commands.train import successful_demonstrations
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io
from layflat.sim.robots.registry import robot_spec


def _run(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main.main(arguments)
    out, err = capsys.readouterr()
    return int(stop.value.code or 0), out, err


@pytest.fixture
def session(tmp_path, make_episode):
    def write(*outcomes: str):
        path = tmp_path / "demos.h5"
        with SessionRecorder(path, robot=robot_spec("hanger"), cloth="towel") as recorder:
            for seed, outcome in enumerate(outcomes):
                recorder.save(make_episode(source="scripted", seed=seed, disturbed=False, outcome=outcome))
        return path

    return write


def test_trains_on_successes_only_and_writes_a_model_that_predicts_them(session, tmp_path, capsys):
    data, model = session("success", "failure", "success"), tmp_path / "m.npz"
    status, out, _ = _run(capsys, "train", str(data), str(model), "--policy", "gp-baseline")
    assert status == 0
    assert "2 demonstrations" in out
    assert "held-out" in out
    learned = model_io.load(model)
    demonstrations = successful_demonstrations(data)
    mean, _ = learned.predict(learned.layout.select(demonstrations.observations))
    wanted = demonstrations.actions
    assert np.sqrt(((mean - wanted) ** 2).mean()) < 0.25 * wanted.std()
    assert learned.provenance.versions["python"]


def test_corrections_are_reported_and_weighted(tmp_path, make_episode, capsys):
    plain, taken = make_episode(seed=0, disturbed=False), make_episode(seed=1, disturbed=False)
    steps = [replace(step, intervention=step_index in range(20, 27)) for step_index, step in enumerate(taken.steps)]
    with SessionRecorder(tmp_path / "plain.h5", robot=robot_spec("hanger"), cloth="towel") as recorder:
        recorder.save(plain)
    with SessionRecorder(tmp_path / "s.h5", robot=robot_spec("hanger"), cloth="towel") as recorder:
        for episode in (plain, replace(taken, steps=steps)):
            recorder.save(episode)
    call = ["train", str(tmp_path / "s.h5"), str(tmp_path / "m.npz"), "--intervention-weight", "3"]
    status, out, _ = _run(capsys, *call, "--policy", "gp-baseline")
    assert status == 0
    assert "7 steps in which a person corrected a policy count 3 times each" in out
    assert model_io.load(tmp_path / "m.npz").n_points == 120 + 2 * 7
    for wrong, sentence in ((["--policy", "gmr"], "gmr cannot weight"), (["--intervention-weight", "0"], "equal to 1")):
        status, _, err = _run(capsys, *call, "--force", *wrong)
        assert status == 2
        assert sentence in err
    status, _, err = _run(capsys, "train", str(tmp_path / "plain.h5"), *call[2:], "--force")
    assert status == 2
    assert "has no intervention steps" in err


@pytest.mark.parametrize("policy", ["gmr", "dmp", "nearest"])
def test_every_other_method_trains_the_same_way(policy, session, tmp_path, capsys):
    model = tmp_path / "m.npz"
    status, out, _ = _run(capsys, "train", str(session("success", "success")), str(model), "--policy", policy)
    assert status == 0
    learned = model_io.load(model)
    assert learned.policy == policy
    assert f"{learned.n_points} {learned.point_name} of {learned.points_available} steps in 2 demonstrations" in out
    assert learned.heldout_rmse_m is not None
    assert f"{1000 * learned.heldout_rmse_m[0]:.2f}" in out


def test_one_demonstration_has_no_held_out_error_and_says_so(session, tmp_path, capsys):
    status, out, _ = _run(capsys, "train", str(session("success")), str(tmp_path / "m.npz"), "--policy", "gp-baseline")
    assert status == 0
    assert "needs 2" in out


@pytest.mark.parametrize("outcomes", [(), ("failure", "partial")])
def test_nothing_to_learn_from_is_a_wrong_call(outcomes, session, tmp_path, capsys):
    status, out, err = _run(capsys, "train", str(session(*outcomes)), str(tmp_path / "m.npz"))
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert "record" in err
    assert not (tmp_path / "m.npz").exists()
