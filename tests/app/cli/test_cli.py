"""Wrong calls end before any work, with status 2 and one sentence; help needs nothing heavy."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_args

import pytest
import typer

from layflat.app.cli import main
from layflat.app.commands.analyze_frame import FrameConfig
from layflat.app.commands.demo import DemoConfig
from layflat.app.commands.evaluate import ENGINES, EvaluateConfig
from layflat.app.commands.flatten import FlattenConfig
from layflat.app.commands.place import PlaceConfig
from layflat.app.commands.replay import MODES, ReplayConfig
from layflat.app.commands.train import TrainConfig
from layflat.app.evaluation.suites import shipped
from layflat.app.reproduce.run import ReproduceConfig
from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workstation.teleop.registry import TELEOPERATORS
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.policy.features import Frame
from layflat.policy.registry import TRAINABLE_POLICIES, WRAPPERS
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS
from layflat.policy.spec import builtin_names
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.starts.registry import STARTS
from layflat.sim.tasks import TASKS

COMMANDS = typer.main.get_command(main.cli).commands

CONFIGS = {
    "record": RecordConfig,
    "train": TrainConfig,
    "place": PlaceConfig,
    "flatten": FlattenConfig,
    "evaluate": EvaluateConfig,
    "disturb": EvaluateConfig,
    "replay": ReplayConfig,
    "word": FrameConfig,
    "demo": DemoConfig,
    "reproduce": ReproduceConfig,
}
POLICIES = [*builtin_names("place"), *WRAPPERS]
CHOICES = {
    ("record", "robot"): ROBOTS,
    ("record", "task"): TASKS,
    ("record", "cloth"): CLOTHS,
    ("record", "source"): ["scripted", *TELEOPERATORS],
    ("record", "descriptor"): DESCRIPTORS,
    ("train", "policy"): TRAINABLE_POLICIES,
    ("train", "frame"): get_args(Frame),
    ("place", "policy"): POLICIES,
    ("place", "wrappers"): WRAPPERS,
    ("place", "disturbance"): DISTURBANCES,
    ("place", "robot"): ROBOTS,
    ("place", "cloth"): CLOTHS,
    ("flatten", "controller"): CONTROLLERS,
    ("flatten", "descriptor"): DESCRIPTORS,
    ("flatten", "cloth"): CLOTHS,
    ("evaluate", "policies"): [*POLICIES, *builtin_names("smooth")],
    ("evaluate", "disturb"): [*shipped(), *(name for name in DISTURBANCES if name != "none")],
    ("evaluate", "robots"): ROBOTS,
    ("evaluate", "cloths"): CLOTHS,
    ("evaluate", "task"): TASKS,
    ("evaluate", "start"): STARTS,
    ("evaluate", "engine"): ENGINES,
    ("demo", "robots"): ROBOTS,
    ("demo", "cloth"): CLOTHS,
    ("word", "descriptor"): DESCRIPTORS,
    ("replay", "mode"): MODES,
}


@pytest.mark.parametrize(("command", "name"), CHOICES)
def test_the_help_of_an_option_names_every_entry_of_its_registry(command, name):
    (option,) = (option for option in COMMANDS[command].params if option.name == name)
    words = re.findall(r"[\w-]+", f"{option.help} {option.metavar}")
    assert [choice for choice in CHOICES[command, name] if choice not in words] == []


@pytest.mark.parametrize("command", CONFIGS)
def test_options_are_fields_of_the_config_with_the_same_defaults(command):
    config = {field.name: field.default for field in fields(CONFIGS[command])}
    options = {option.name: option for option in COMMANDS[command].params}
    assert {*options} - {"workers", "force", "debug", "physics"} == {*config}
    assert ("physics" in options) == ("settings" in config and command != "replay")  # it is one of the settings
    for name, default in config.items():
        shown = options[name].show_default if isinstance(options[name].show_default, str) else options[name].default
        if shown is not None and default is not MISSING and isinstance(default, (int, float, str)):
            assert shown == default, name


def _run(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main.main(arguments)
    out, err = capsys.readouterr()
    return int(stop.value.code or 0), out, err


WRONG = [
    ("nonsense",),
    ("place",),
    ("demo",),
    ("demo", "--out", "x", "--episodes", "0"),
    ("demo", "--out", "x", "--episodes", "-3"),
    ("demo", "--out", "x", "--episodes", "many"),
    ("demo", "--out", "x", "--workers", "0"),
    ("demo", "--out", "x", "--seed", "-1"),
    ("demo", "--out", "x", "--robot", "arm"),
    ("record", "x.h5", "--episodes", "0"),
    ("record", "x.h5", "--source", "telepathy"),
    ("gamepad", "shake"),
    ("gamepad", "monitor", "--seconds", "-1"),
    ("gamepad", "monitor", "--file", "x.json"),
    ("place", "x.npz", "--episodes", "-3"),
    ("train", "x.h5", "m.npz", "--policy", "gmrx"),
    ("record", "x.h5", "--task", "iron"),
    ("record", "x.h5", "--task", "smooth", "--robot", "hanger"),
    ("evaluate", "hold", "--robot", "pickers", "--task", "smooth", "--out", "x"),
    ("place", "word"),
    ("train", "x.h5", "m.npz", "--nope"),
    ("train", "x.h5"),
    ("train", "x.h5", "m.npz", "--intervention-weight", "0"),
    ("record", "x.h5", "--correct", "m.npz"),
    ("word", "rgb.png"),
    ("word", "rgb.png", "depth.png", "--flat-pixels", "0"),
    ("word", "rgb.png", "depth.png", "--flat-pixels", "many"),
    ("word", "rgb.png", "depth.png", "--depth-scale", "metres"),
    ("word", "rgb.png", "depth.png"),
    ("flatten", "--controller", "iron"),
    ("flatten", "--descriptor", "sift"),
    ("flatten", "--episodes", "0"),
    ("flatten", "--cloth", "silk"),
    ("flatten", "--video", "x.mp4"),
    ("flatten", "--strip", "x.jpg"),
    ("flatten", "extra"),
    ("reproduce",),
    ("reproduce", "--out", "x", "--seeds", "0"),
    ("reproduce", "--out", "x", "--only", "nonsense"),
    ("reproduce", "--out", "x", "--workers", "0"),
    ("evaluate",),
    ("evaluate", "hold", "--robot", "hanger"),
    ("evaluate", "hold", "--out", "x"),
    ("evaluate", "nope.npz", "--out", "x"),
    ("evaluate", "hold", "--robot", "arm", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--cloth", "silk", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--disturb", "soap", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--disturb", "mine.toml", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--start", "crumpled", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--limit-s", "0", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--engine", "abacus", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--address", "there:1", "--out", "x"),
    ("evaluate", "hold", "hold", "--robot", "hanger", "--out", "x"),
    ("evaluate", "hold", "--robot", "hanger", "--episodes", "0", "--out", "x"),
    ("disturb", "hold", "--robot", "hanger", "--suite", "soap", "--out", "x"),
    ("doctor", "extra"),
    ("data", "nonsense"),
    ("data", "info"),
    ("replay", "x.h5"),
    ("replay", "x.h5", "--episode", "-1"),
    ("replay", "x.h5", "--episode", "0", "--mode", "dream"),
]


@pytest.mark.parametrize("arguments", WRONG, ids=" ".join)
def test_wrong_calls_are_one_sentence_and_status_2(arguments, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    status, out, err = _run(capsys, *arguments)
    assert status == 2
    assert out == ""
    assert err.startswith("layflat: ")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_message_names_the_value_and_what_would_be_right(capsys):
    for command in (("record", "x.h5"), ("place", "hold")):
        assert "--episodes is -3; at least 1 is needed" in _run(capsys, *command, "--episodes", "-3")[2]
    err = _run(capsys, "demo", "--out", "x", "--robot", "arm")[2]
    assert "'arm'" in err
    assert all(robot in err for robot in ROBOTS)


@pytest.mark.parametrize("flag", ["-h", "--help"])
@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_of_every_command(command, flag, capsys):
    status, out, err = _run(capsys, *([command] if command else []), flag)
    assert (status, err) == (0, "")
    assert "Usage: layflat" in out


def test_help_imports_nothing_heavy():
    heavy = ("numpy", "pybullet", "cv2", "GPy", "matplotlib", "h5py", "scipy", "pandas", "pygame")
    program = (
        "import sys\nfrom layflat.app.cli.main import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        f"print([m for m in {heavy} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


def test_another_interpreter_gets_one_sentence(capsys, monkeypatch):
    monkeypatch.setattr(validators, "SUPPORTED_PYTHONS", ((3, 8),))
    status, _, err = _run(capsys, "place", "x.npz")
    assert status == 1
    assert err.count("\n") == 1
    assert "3.10 to 3.13" in err
    assert "doctor" in err


def test_a_missing_simulator_gets_one_sentence(monkeypatch):
    monkeypatch.setattr(validators.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(LayflatError, match="PyBullet is not installed"):
        validators.require_simulator()


def test_unknown_cloth_lists_the_known_ones():
    with pytest.raises(UsageError, match="cloth 'silk' is unknown; known ones are napkin, towel"):
        validators.one_of("cloth", "silk", ["towel", "napkin"])
    assert validators.one_of("cloth", "towel", ["towel", "napkin"]) == "towel"


def test_existing_output_needs_force(tmp_path):
    path = tmp_path / "m.npz"
    path.write_bytes(b"old")
    with pytest.raises(UsageError, match="--force"):
        validators.writable_file(path, force=False)
    assert validators.writable_file(path, force=True) == path
    assert validators.writable_file(path, force=False, append=True) == path
    assert path.read_bytes() == b"old"


def test_output_that_cannot_be_written_is_found_before_the_work(tmp_path):
    blocker = tmp_path / "file"
    blocker.touch()
    for path in (blocker / "m.npz", Path("/proc/nowhere/m.npz"), Path("/dev/null/m.npz")):
        with pytest.raises(UsageError, match="cannot be written"):
            validators.writable_file(path, force=False)
    with pytest.raises(UsageError, match="is a folder"):
        validators.writable_file(tmp_path, force=True)


def test_a_good_output_path_leaves_nothing_behind(tmp_path):
    validators.writable_file(tmp_path / "new" / "m.npz", force=False)
    assert not list((tmp_path / "new").iterdir())
