"""The demo's checks and its folder; the whole story on real physics is the slow test."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from layflat.app.cli import main
from layflat.app.commands.demo import DEMONSTRATIONS, FINISHER, RULE, _clear
from layflat.app.support.metrics import COLUMNS
from layflat.data.session.reader import open_session


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
    mine = {"thesis.pdf", "demonstrations-hanger-old.h5", "gp-word-pickers.npz"}
    theirs = {"demonstrations-hanger.h5", "gp-word-hanger.npz", "gp-baseline-hanger.npz", "report.html", "episodes.csv"}
    for name in mine | theirs:
        (tmp_path / name).write_text("x")
    _clear(tmp_path, ("hanger",))
    assert {path.name for path in tmp_path.iterdir()} == mine


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_whole_story_goes_on_after_ctrl_c(tmp_path):
    out = tmp_path / "demo"
    command = [
        sys.executable,
        "-m",
        "layflat.app.cli.main",
        "demo",
        "--out",
        str(out),
        "--episodes",
        "1",
        "--robot",
        "hanger",
    ]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    first = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    kept = []
    assert first.stderr is not None
    for line in first.stderr:
        if "demonstrations 3/" in line:
            first.send_signal(signal.SIGINT)
        kept.append(line)
    assert first.wait() == 130, "".join(kept)
    session = out / "demonstrations-hanger.h5"
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
        flat = sum(recorded.info(name).outcome == "success" for name in recorded.names)
    assert before.items() <= after.items(), "what was there was recorded again"
    assert len(after) == DEMONSTRATIONS
    assert flat >= 9
    page = (out / "report.html").read_text()
    assert "data:video/webm;base64," in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    with (out / "episodes.csv").open() as file:
        rows = {row["policy"]: row for row in csv.DictReader(file)}
    assert tuple(rows["gp-word"]) == COLUMNS
    assert set(rows) == {"gp-baseline", "gp-word", f"gp-baseline+{RULE}", FINISHER}
    assert float(rows[FINISHER]["contact_placed"]) > 0.97
    assert float(rows[FINISHER]["contact_final"]) > 0.97
    assert float(rows["gp-word"]["contact_placed"]) > 0.95
    assert float(rows["gp-word"]["contact_final"]) - float(rows["gp-word"]["contact_disturbed"]) > 0.05
    assert float(rows["gp-baseline"]["contact_final"]) - float(rows["gp-baseline"]["contact_disturbed"]) < 0.05
    assert json.loads((out / "summary.json").read_text())["schema"] == 1
