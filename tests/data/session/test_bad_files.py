"""Files that are missing, foreign, cut short, damaged or hostile: one DataError, and nothing is touched."""

from __future__ import annotations

import json
import os
import random

import h5py
import numpy as np
import pytest

from layflat.data import SessionRecorder, open_session
from layflat.data.errors import DataError
from layflat.tests.factories import HANGER, PICKERS, differences, make_episode


@pytest.fixture
def session_path(tmp_path):
    path = tmp_path / "session.h5"
    with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
        for seed in range(2):
            recorder.save(make_episode(n_steps=3, seed=seed, nodes=4, images=True))
    return path


def _refused(path, match=None):
    """The one sentence, which must name the file."""
    with pytest.raises(DataError, match=match) as caught, open_session(path) as session:
        list(session)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_not_a_file(tmp_path):
    _refused(tmp_path / "none.h5", "does not exist")
    _refused(tmp_path, "is not a file")
    (tmp_path / "loop.h5").symlink_to(tmp_path / "nowhere.h5")
    _refused(tmp_path / "loop.h5", "does not exist")
    _refused(tmp_path / ("x" * 300), "cannot be read: File name too long")


def test_an_open_file_is_closed_again_after_a_refusal(session_path):
    with h5py.File(session_path, "r+") as f:
        del f["data/demo_1/actions"]
    _refused(session_path, "demo_1 has no data set actions")
    with h5py.File(session_path, "r+"):
        pass  # HDF5 would refuse if a reader still held it.


@pytest.mark.parametrize("content", [b"", b"x", b"\x89HDF\r\n\x1a\n", b"PK\x03\x04" * 100, bytes(4096), b"seed,word\n"])
def test_not_hdf5(tmp_path, content):
    path = tmp_path / "s.h5"
    path.write_bytes(content)
    _refused(path)
    with pytest.raises(DataError):
        SessionRecorder(path, robot=HANGER, cloth="towel")
    assert path.read_bytes() == content
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


def test_cut_short_anywhere(session_path, tmp_path):
    whole, path = session_path.read_bytes(), tmp_path / "cut.h5"
    rng = random.Random(0)
    for length in [0, 1, 7, 8, 9, 47, 48, len(whole) - 1, *(rng.randrange(len(whole)) for _ in range(40))]:
        path.write_bytes(whole[:length])
        _refused(path)


def test_one_wrong_bit_is_never_read_as_something_else(session_path, tmp_path):
    with open_session(session_path) as session:
        ground_truth = list(session)
    whole, path = session_path.read_bytes(), tmp_path / "flipped.h5"
    rng, noticed = random.Random(1), 0
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            with open_session(path) as session:
                found = list(session)
        except DataError:
            noticed += 1
        else:
            assert [differences(a, b) for a, b in zip(found, ground_truth, strict=True)] == [[], []]
    assert noticed > 20


def test_foreign_hdf5_is_refused_and_not_touched(tmp_path):
    plain, robomimic, newer = (tmp_path / f"{name}.h5" for name in ("plain", "robomimic", "newer"))
    with h5py.File(plain, "w") as f:
        f["x"] = np.arange(3)
    for path in (robomimic, newer):
        with h5py.File(path, "w") as f:
            f["data/demo_0/actions"] = np.zeros((2, 2))
            f["data"].attrs["total"] = 2
            f["data"].attrs["env_args"] = json.dumps({"type": 1, "env_name": "Lift", "env_kwargs": {}})
            if path is newer:
                f["data"].attrs.update({"schema": np.bytes_("layflat-episodes"), "schema_version": 99})
    foreign = "another program"
    for path, message in ((plain, foreign), (robomimic, foreign), (newer, "version 99.*version 1")):
        before = path.read_bytes()
        _refused(path, message)
        with pytest.raises(DataError, match=message):
            SessionRecorder(path, robot=HANGER, cloth="towel")
        assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 3


def _replace(f, key, value, **how):
    del f[key]
    f.create_dataset(key, data=value, **how)


def _virtual(f):
    layout = h5py.VirtualLayout((3, 2), "<f8")
    layout[:] = h5py.VirtualSource("/etc/hostname.h5", "x", (3, 2))
    del f["data/demo_0/actions"]
    f["data/demo_0"].create_virtual_dataset("actions", layout)


def _huge(f):
    del f["data/demo_0/states"]
    f["data/demo_0"].create_dataset("states", (3, 3 * 10**11), "<f8", chunks=(1, 1000))


def _all_huge(f):
    _huge(f)
    f["data/demo_0"].attrs["num_samples"] = 10**12


def _linked(link, key="data/demo_0/obs/word"):
    def change(f):
        del f[key]
        f[key] = link

    return change


HOSTILE = {
    "float32 actions": lambda f: _replace(f, "data/demo_0/actions", np.zeros((3, 2), "<f4")),
    "text actions": lambda f: _replace(f, "data/demo_0/actions", np.zeros((3, 2), "S3")),
    "python objects": lambda f: _replace(f, "data/demo_0/phase", ["a", "b", "c"], dtype=h5py.string_dtype()),
    "empty data space": lambda f: _replace(f, "data/demo_0/actions", h5py.Empty("<f8")),
    "three columns": lambda f: _replace(f, "data/demo_0/actions", np.zeros((3, 3))),
    "fewer rows": lambda f: _replace(f, "data/demo_0/obs/word", np.zeros((2, 2))),
    "other node count": lambda f: _replace(f, "data/demo_0/ground_truth/final_state", np.zeros(9)),
    "not three per node": lambda f: (
        _replace(f, "data/demo_0/states", np.zeros((3, 4))),
        _replace(f, "data/demo_0/ground_truth/final_state", np.zeros(4)),
    ),
    "nan": lambda f: f["data/demo_0/obs/word"].write_direct(np.full((3, 2), np.nan)),
    "phase": lambda f: f["data/demo_0/phase"].write_direct(np.array([b"x"] * 3, "S8")),
    "actions that are not action_m": lambda f: f["data/demo_0/actions"].write_direct(np.full((3, 2), 0.5)),
    "group for data set": lambda f: (f.__delitem__("data/demo_0/rewards"), f.create_group("data/demo_0/rewards")),
    "data set for group": lambda f: _replace(f, "data/demo_0/ground_truth", np.zeros(3)),
    "rgb in obs only": lambda f: f.__delitem__("data/demo_0/next_obs/rgb"),
    "virtual": _virtual,
    "huge": _huge,
    "all huge": _all_huge,
    "soft link": _linked(h5py.SoftLink("/data/demo_1/obs/word")),
    "external link": _linked(h5py.ExternalLink("/etc/passwd", "/x")),
    "linked demo": _linked(h5py.SoftLink("/data/demo_0"), "data/demo_1"),
    "linked data": lambda f: (f.move("data", "d"), f.__setitem__("data", h5py.SoftLink("/d"))),
    "member that is no demo": lambda f: f["data"].create_group("extra"),
    "demo number": lambda f: f["data"].create_group("demo_x"),
    "seed changed": lambda f: f["data/demo_0"].attrs.__setitem__("seed", 5),
    "seed as text": lambda f: f["data/demo_0"].attrs.__setitem__("seed", "5"),
    "no uid": lambda f: f["data/demo_0"].attrs.__delitem__("uid"),
    "total": lambda f: f["data"].attrs.__setitem__("total", 7),
    "total as array": lambda f: f["data"].attrs.__setitem__("total", np.arange(3)),
    "other robot": lambda f: f["data"].attrs.__setitem__("robot", "pickers"),
    "unknown robot": lambda f: f["data"].attrs.__setitem__("robot", "fold"),
    "other step": lambda f: f["data"].attrs.__setitem__("step_s", 0.2),
    "other action limit": lambda f: f["data"].attrs.__setitem__("action_limit_m", 0.05),
    "schema as array": lambda f: f["data"].attrs.__setitem__("schema", ["layflat-episodes"] * 2),
}


@pytest.mark.parametrize("change", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_or_edited(session_path, change):
    with h5py.File(session_path, "r+") as f:
        change(f)
    _refused(session_path)


def test_append_must_agree(session_path):
    before = session_path.read_bytes()
    with pytest.raises(DataError, match="has robot hanger, not pickers"):
        SessionRecorder(session_path, robot=PICKERS, cloth="towel")
    with pytest.raises(DataError, match="has cloth towel, not napkin"):
        SessionRecorder(session_path, robot=HANGER, cloth="napkin")
    with (
        SessionRecorder(session_path, robot=HANGER, cloth="towel") as recorder,
        pytest.raises(DataError, match=r"step_s is 0\.05"),
    ):
        recorder.save(make_episode(step_s=0.05))
    with pytest.raises(DataError, match="robot is 'fold'; it must be a RobotSpec"):
        SessionRecorder(session_path, robot="fold", cloth="towel")
    assert session_path.read_bytes() == before
    assert [p.name for p in session_path.parent.iterdir()] == [session_path.name]


def test_places_that_cannot_be_written_are_refused_at_once(tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "taken.h5.parts").write_text("x")
    os.mkfifo(tmp_path / "pipe")
    for path, message in (
        (tmp_path / "missing" / "s.h5", "missing does not exist"),
        (tmp_path / "file" / "s.h5", "file is not a folder"),
        (tmp_path, "is a folder; name a file"),
        (tmp_path / "pipe", "not a regular file"),
        (tmp_path / "taken.h5", "cannot be written"),
        (tmp_path / ("x" * 300), "cannot be written: File name too long"),
        (tmp_path / ("x" * 253), "cannot be written: File name too long"),
    ):
        with pytest.raises(DataError, match=message) as caught:
            SessionRecorder(path, robot=HANGER, cloth="towel")
        assert "\n" not in str(caught.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "pipe", "taken.h5.parts"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_write_protected(tmp_path, session_path):
    session_path.chmod(0o444)
    with pytest.raises(DataError, match="write-protected"):
        SessionRecorder(session_path, robot=HANGER, cloth="towel")
    tmp_path.chmod(0o555)
    with pytest.raises(DataError, match="Permission denied"):
        SessionRecorder(tmp_path / "new.h5", robot=HANGER, cloth="towel")
    tmp_path.chmod(0o755)
