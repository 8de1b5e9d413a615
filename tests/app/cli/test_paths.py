"""Paths as they are typed: a leading ~, wrong suffixes, missing folders; and the help of every command."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli import main
from layflat.app.evaluation.suites import cases_of
from layflat.app.support.errors import UsageError
from layflat.policy import model_io
from layflat.policy.spec import PolicySpec
from layflat.tests.factories import write_session


@pytest.fixture
def home(tmp_path, monkeypatch, make_episode) -> Path:
    """A home with a session and a model; the current folder is another one."""
    for name in ("home", "here"):
        (tmp_path / name).mkdir()
    write_session(tmp_path / "home" / "s.h5", [make_episode()])
    model_io.save(random_model("hanger", 20), tmp_path / "home" / "m.npz")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path / "home"


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stop:
        main.main(arguments)
    return int(stop.value.code or 0)


def test_a_leading_tilde_is_the_home_in_options_and_arguments(home):
    assert call("data", "plot", "~/s.h5", "--out=~/new/p.png") == 0
    assert call("data", "merge", "~/s.h5", "~/s.h5", "--out=~/new.h5") == 0
    assert (home / "new" / "p.png").exists()
    assert (home / "new.h5").exists()
    assert not list(Path().iterdir())


@pytest.mark.parametrize("text", ["~/m.npz", "mine=~/m.npz", "~/m.npz+recovery"])
def test_a_leading_tilde_is_the_home_in_a_policy(home, text):
    assert PolicySpec.parse(text).stem == "m"


def test_a_leading_tilde_is_the_home_in_a_suite(home):
    with pytest.raises(UsageError, match=rf"{home}/none\.toml"):
        cases_of("~/none.toml")


def test_a_name_that_only_looks_like_a_home_stays(home):
    assert call("data", "merge", str(home / "s.h5"), "--out=~no-such-user.h5") == 0
    assert Path("~no-such-user.h5").exists()


@pytest.mark.parametrize(
    ("command", "wanted"),
    [
        ("record a.txt", ".h5 or .hdf5"),
        ("record a", ".h5 or .hdf5"),
        ("place hold --robot hanger --record a.txt", ".h5 or .hdf5"),
        ("place hold --robot hanger --json a.txt", ".json"),
        ("place hold --robot hanger --video a.mp4", ".webm"),
        ("flatten --strip a.jpg", ".png"),
        ("train {home}/s.h5 a.h5", ".npz"),
        ("data info {home}/s.h5 --json a", ".json"),
        ("data stats {home}/s.h5 --json a", ".json"),
        ("data validate {home}/s.h5 --json a", ".json"),
        ("data filter {home}/s.h5 --out a.csv", ".h5 or .hdf5"),
        ("data merge {home}/s.h5 --out a", ".h5 or .hdf5"),
        ("data repair {home}/s.h5 --out a", ".h5 or .hdf5"),
        ("data trim {home}/s.h5 --episode 0 --out a", ".h5 or .hdf5"),
        ("data export {home}/s.h5 --out a", ".h5 or .hdf5"),
        ("data plot {home}/s.h5 --out a.pdf", ".png"),
        ("data video {home}/s.h5 --episode 0 --out a.mp4", ".webm"),
        ("replay {home}/s.h5 --episode 0 --json a", ".json"),
        ("bench --json a", ".json"),
    ],
)
def test_a_wrong_suffix_is_refused_before_the_work(home, capsys, command, wanted):
    assert call(*command.format(home=home).split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.endswith(f"is not a {wanted} file; give a name that ends in {wanted}\n")
    assert not list(Path().iterdir())


def test_a_capital_suffix_is_one(home):
    assert call("data", "merge", str(home / "s.h5"), "--out", "NEW.H5") == 0


def commands(app: typer.Typer, *before: str) -> list[tuple[str, ...]]:
    named = [(*before, command.name or command.callback.__name__) for command in app.registered_commands]
    groups = [(*before, group.typer_instance.info.name) for group in app.registered_groups]
    inner = [commands(group.typer_instance, *name) for group, name in zip(app.registered_groups, groups, strict=True)]
    return [*named, *groups, *(name for names in inner for name in names)]


@pytest.mark.parametrize("words", [(), *commands(main.cli)], ids=" ".join)
def test_every_command_takes_h(words, capsys):
    assert call(*words, "-h") == 0
    assert capsys.readouterr().out.startswith(f"Usage: {' '.join(('layflat', *words))} ")


@pytest.mark.parametrize("words", [(), ("data",), ("gamepad",)])
def test_a_group_alone_lists_its_commands(words, capsys):
    assert call(*words) == 0
    out, err = capsys.readouterr()
    assert ("\nCommands:\n" in out, err) == (True, "")


def test_a_wrong_command_of_a_group_is_answered_with_its_help(capsys):
    assert call("data", "nonsense") == 2
    assert capsys.readouterr().err == "layflat: No such command 'nonsense'; `layflat data --help` lists what there is\n"
