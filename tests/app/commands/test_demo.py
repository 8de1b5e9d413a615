"""The demo's checks and its folder; the whole demo on real physics is the slow test."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time

import cv2
import pytest

from layflat.app.cli import main
from layflat.app.commands.demo import DEMONSTRATIONS, FINISHER, clear_demo, model_specs
from layflat.app.evaluation.run import folder_lock
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.support.metrics import COLUMNS
from layflat.data.session.reader import open_session

MOMENTS = ("placed", "disturbed", "final")


def status_of(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stopped:
        main.main(["demo", *arguments])
    return int(stopped.value.code or 0)


def one_sentence(capsys) -> str:
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    assert "Traceback" not in lines[0]
    return lines[0]


def test_a_file_is_no_folder(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("precious")
    assert status_of("--out", str(tmp_path / "notes.txt")) == 2
    assert "notes.txt" in one_sentence(capsys)
    assert (tmp_path / "notes.txt").read_text() == "precious"


def test_a_folder_below_a_file_cannot_be_written(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("precious")
    assert status_of("--out", str(tmp_path / "notes.txt" / "demo")) == 2
    one_sentence(capsys)


@pytest.mark.parametrize(
    "command", [("demo",), ("evaluate", "hold", "--robot", "hanger"), ("reproduce", "--report-only")], ids=" ".join
)
def test_a_folder_in_which_another_command_works_is_left_alone(tmp_path, capsys, command):
    out = tmp_path / "d"
    with folder_lock(out):
        before = sorted(out.rglob("*"))
        with pytest.raises(SystemExit) as stopped:
            main.main([*command, "--out", str(out)])
        assert stopped.value.code == 2
        err = capsys.readouterr().err.splitlines()[-1]
        assert err.startswith(f"layflat: {out} is being written by another program (process {os.getpid()}); wait")
        assert sorted(out.rglob("*")) == before
    assert not list(out.iterdir())


def test_the_lock_of_a_program_that_was_killed_does_not_stay(tmp_path):
    program = "import os, sys; from pathlib import Path; from layflat.app.evaluation.run import folder_lock\n"
    program += "with folder_lock(Path(sys.argv[1])): os.kill(os.getpid(), 9)"
    assert subprocess.run([sys.executable, "-c", program, str(tmp_path)]).returncode == -9
    assert (tmp_path / ".running").exists()
    with folder_lock(tmp_path):
        pass


def test_an_unknown_cloth_gets_the_list(tmp_path, capsys):
    assert status_of("--out", str(tmp_path / "demo"), "--cloth", "silk") == 2
    sentence = one_sentence(capsys)
    assert "silk" in sentence
    assert "napkin" in sentence
    assert not (tmp_path / "demo").exists()


def test_a_finished_report_is_not_replaced_unasked(tmp_path, capsys):
    (tmp_path / "report.html").write_text("precious")
    assert status_of("--out", str(tmp_path)) == 2
    assert "--force" in one_sentence(capsys)
    assert (tmp_path / "report.html").read_text() == "precious"


@pytest.mark.parametrize("count", ["0", "-3", "many"])
def test_counts_below_one(tmp_path, capsys, count):
    assert status_of("--out", str(tmp_path / "demo"), "--episodes", count) == 2
    one_sentence(capsys)


def test_force_removes_only_what_a_demo_writes(tmp_path):
    store = ArtifactStore(tmp_path, seed=0)
    session = store.session_path("hanger", "towel")
    written = [session, *(store.model_path(spec) for spec in model_specs("hanger", "towel"))]
    written += [tmp_path / name for name in ("report.html", "episodes.csv", "frames.png", "summary.json")]
    others = [tmp_path / "thesis.pdf", session.with_name("old.h5")]
    others += [store.model_path(spec) for spec in model_specs("pickers", "towel")]
    for path in (*written, *others):
        path.parent.mkdir(exist_ok=True)
        path.write_text("x")
    clear_demo(tmp_path, store, ("hanger",), "towel")
    assert not any(path.exists() for path in written)
    assert all(path.exists() for path in others)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_demo_continues_after_ctrl_c(tmp_path):
    out = tmp_path / "demo"
    options = ["--out", str(out), "--episodes", "1", "--robot", "hanger"]
    command = [sys.executable, "-m", "layflat.app.cli.main", "demo", *options]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    first = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    lines = []
    assert first.stderr is not None
    for line in first.stderr:
        if "demonstrations 3/" in line:
            first.send_signal(signal.SIGINT)
        lines.append(line)
    assert first.wait() == 130, "".join(lines)
    session = ArtifactStore(out, seed=0).session_path("hanger", "towel")
    with open_session(session) as recorded:
        before = {name: recorded.info(name).uid for name in recorded.names}
    assert len(before) >= 3

    began = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == f"report: {out / 'report.html'}"
    assert time.monotonic() - began < 720
    with open_session(session) as recorded:
        after = {name: recorded.info(name).uid for name in recorded.names}
        n_flat = sum(recorded.info(name).outcome == "success" for name in recorded.names)
    assert before.items() <= after.items(), "a demonstration was recorded again"
    assert n_flat == DEMONSTRATIONS
    assert len(after) <= DEMONSTRATIONS + 1
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "data:image/jpeg;base64," in page
    text = re.sub(r"<[^>]+>", "", page)
    assert "gp-word, thesis" in text
    assert "Where the contact is held" in text
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert cv2.imread(str(out / "frames.png")).shape[1] > 1000
    with (out / "episodes.csv").open() as file:
        rows = {row["policy"]: row for row in csv.DictReader(file) if row["disturbance"] == "thesis"}
    assert set(COLUMNS) <= set(rows["gp-word"])
    assert set(rows) == {"gp-baseline", "gp-word", "gp-baseline+drag-rule", FINISHER}
    numbers = {name: {key: float(row[f"contact_{key}"]) for key in MOMENTS} for name, row in rows.items()}
    assert numbers[FINISHER]["placed"] > 0.97
    assert numbers[FINISHER]["final"] > 0.97
    assert numbers["gp-word"]["placed"] > 0.95
    assert numbers["gp-word"]["final"] - numbers["gp-word"]["disturbed"] > 0.05
    assert numbers["gp-baseline"]["final"] - numbers["gp-baseline"]["disturbed"] < 0.05
    assert json.loads((out / "summary.json").read_text())["schema"] == 1
