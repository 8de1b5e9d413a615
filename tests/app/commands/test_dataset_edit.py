"""`layflat data edit`: what it prints, its statuses, and that other commands read through it."""

import json

import pytest

from layflat.app.cli import main
from tests.factories import make_episode, write_session


@pytest.fixture
def run(capsys):
    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            main.main([str(word) for word in arguments])
        return int(stop.value.code or 0), *capsys.readouterr()

    return call


@pytest.fixture
def path(tmp_path):
    return write_session(tmp_path / "s.h5", [make_episode(n_steps=6, seed=k) for k in range(3)])


def test_an_afternoon_of_edits(run, path, tmp_path):
    def edit(*values):
        status, out, err = run("data", "edit", path, *values)
        assert status == 0, err
        return out.strip()

    assert edit() == f"no edits {path}"
    assert edit("relabel", "demo_1", "failure") == f"edit 1: demo_1 is failure, was success {path}"
    assert edit("trim", "2", "1", "4") == f"edit 2: demo_2 has 3 of 6 steps, partial {path}"
    assert edit("note", "demo_1", "hem", "folded") == f"edit 3: demo_1 has the note 'hem folded' {path}"
    assert edit("drop", "demo_0", "demo_2").splitlines() == [
        f"edit 4: drop demo_0, 2 episodes {path}",
        f"edit 5: drop demo_2, 1 episodes {path}",
    ]
    assert edit("undo") == f"edit 6: undid edit 5, drop demo_2 {path}"
    assert edit("undo", "1", "--json", tmp_path / "log.json").startswith("edit 7: undid edit 1, relabel demo_1 failure")
    edits = json.loads((tmp_path / "log.json").read_text())["edits"]
    assert [(row["number"], row["undone"]) for row in edits] == [(n, n in (1, 5)) for n in range(1, 8)]
    assert "undone" in edit("log")
    status, out, _ = run("data", "info", path, "--json", tmp_path / "info.json")
    assert status == 0
    assert "1 dropped: demo_0" in out
    assert "note on demo_1: hem folded" in out
    report = json.loads((tmp_path / "info.json").read_text())
    assert report["dropped"] == ["demo_0"]
    assert [(row["name"], row["outcome"], row["note"]) for row in report["episodes"]] == [
        ("demo_1", "success", "hem folded"),
        ("demo_2", "partial", ""),
    ]
    status, out, _ = run("data", "export", path, "--out", tmp_path / "csv", "--format", "csv")
    assert (status, out.split()[:5]) == (0, ["exported", "2", "episodes,", "9", "steps"])


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (("trim", "demo_0", "1"), "trim takes demo_K FROM TO, got 'demo_0' '1'"),
        (("trim", "demo_0", "a", "3"), "a step must be an integer >= 0, got a"),
        (("undo", "9"), "has no edit 9; it has 0"),
        (("drop", "demo_9"), "has no episode 'demo_9'"),
        (("log", "x"), "log takes no values, got 'x'"),
        (("relabel", "demo_0", "good"), "outcome is 'good'"),
    ],
)
def test_wrong_calls_are_one_sentence(run, path, values, sentence):
    status, out, err = run("data", "edit", path, *values)
    assert (status, out) == (2, "")
    assert sentence in err
    assert err.count("\n") == 1
