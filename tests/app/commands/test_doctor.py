"""The doctor runs, here and where nothing is installed."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from layflat.app.commands import doctor
from layflat.app.support.errors import LayflatError

ROOT = Path(doctor.__file__).parents[2]


def test_this_machine_is_fit(capsys):
    doctor.doctor()
    out = capsys.readouterr().out
    assert "problem" not in out
    assert all(name in out for name in doctor.REQUIRED)


def test_a_missing_package_is_a_problem_with_advice(capsys, monkeypatch):
    monkeypatch.setitem(doctor.REQUIRED, "no-such-package", "no_such_package")
    with pytest.raises(LayflatError, match="no-such-package") as failure:
        doctor.doctor()
    assert failure.value.exit_status == 1
    assert "pip install" in capsys.readouterr().out


def test_another_interpreter_is_a_problem(monkeypatch):
    monkeypatch.setattr(doctor, "SUPPORTED_PYTHONS", ((3, 8),))
    (check,) = doctor.interpreter()
    assert check.state == "problem"
    assert "3.11" in check.advice


def test_it_needs_nothing_but_the_standard_library(tmp_path):
    (tmp_path / "layflat").symlink_to(ROOT)  # A checkout's folder may have any name.
    call = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import layflat.app.commands.doctor as d; d.doctor()"
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", call],
        capture_output=True,
        text=True,
    )
    assert "missing" in done.stdout
    assert "ModuleNotFoundError" not in done.stderr


def test_stdout_begins_with_the_first_check_and_names_the_limits():
    done = subprocess.run([sys.executable, "-m", "layflat.app.cli.main", "doctor"], capture_output=True, text=True)
    assert done.stdout.startswith("ok      interpreter")
    assert "build time" not in done.stdout
    assert "\nok      workers" in done.stdout


def test_either_build_of_pybullet_will_do_but_not_both(monkeypatch):
    monkeypatch.setattr(doctor, "version", lambda name: "3.2.8" if name in there else _missing(name))
    there = {"pybullet-arm64"}
    assert [(check.name, check.state) for check in doctor.engines()] == [
        ("physics bullet", "ok"),
        ("physics mujoco", "note"),
    ]
    there = {"pybullet", "pybullet-arm64"}
    (check,) = doctor.engines()
    assert (check.state, check.found) == ("problem", "pybullet and pybullet-arm64")
    there = set()
    assert doctor.engines()[0].state == "problem"


def _missing(name):
    raise PackageNotFoundError(name)
