"""validate: silent on sound files, says where damage is, and never crashes, hangs or reads elsewhere."""

from __future__ import annotations

import functools
import os
import random
import resource
import time

import h5py
import numpy as np
import pytest

from layflat.data import open_session, repair, validate
from layflat.data.atomic_files import PART_SUFFIX
from layflat.data.errors import DataError
from layflat.data.session.parts import parts_folder
from layflat.data.tools.sandbox import CallError, call_in_sandbox
from layflat.data.tools.validate import violations
from layflat.tests.factories import differences, make_episode, write_session


@pytest.fixture
def path(tmp_path):
    return write_session(
        tmp_path / "s.h5", [make_episode(n_steps=3, seed=seed, nodes=4, images=True) for seed in range(2)]
    )


def _everything(path, target):
    """Reading, checking and repairing one file: what each says, or how it failed to."""
    found = {}
    for name, work in (
        ("read", lambda: _read(path)),
        ("check", lambda: violations(path)),
        ("repair", lambda: repair(path, target, force=True)),
    ):
        try:
            found[name] = work()
        except DataError as error:
            found[name] = str(error)
    return found


def _read(path):
    with open_session(path) as session:
        return list(session)


def test_a_sound_session_has_no_violation(path):
    assert validate(path) == ()


def test_cut_short_at_every_page(path, tmp_path):
    """What comes back, if anything does, is as it was."""
    whole, cut, mended = path.read_bytes(), tmp_path / "cut.h5", tmp_path / "mended.h5"
    ground_truth = {episode.seed: episode for episode in _read(path)}
    for length in range(0, len(whole), 4096):
        cut.write_bytes(whole[:length])
        found = call_in_sandbox(lambda: _everything(cut, mended), limit_s=60, memory_bytes=1 << 30)
        assert found["check"]
        assert isinstance(found["read"], str)
        if not isinstance(found["repair"], str):
            assert validate(mended) == ()
            assert all(differences(episode, ground_truth[episode.seed]) == [] for episode in _read(mended))


@pytest.mark.parametrize(("missing", "least"), [(1, 6), (64, 6), (600, 1)])
def test_a_file_without_its_last_bytes_is_repaired(missing, least, tmp_path):
    ground_truth = [make_episode(n_steps=4, seed=seed) for seed in range(6)]
    path = write_session(tmp_path / "long.h5", ground_truth)
    path.write_bytes(path.read_bytes()[:-missing])
    with pytest.raises(DataError):
        open_session(path)
    report = repair(path)
    assert len(report.intact) >= least
    assert (len(report.intact) < 6) == bool(report.lost)
    assert validate(path) == ()
    assert all(differences(episode, ground_truth[episode.seed]) == [] for episode in _read(path))


def _flip(rng, whole):
    damaged = bytearray(whole)
    damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged)


@pytest.mark.parametrize(
    ("batches", "per_batch"), [(2, 60), pytest.param(20, 100, marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_wrong_bits(tmp_path, batches, per_batch):
    """In batches that share a process, for speed; one that crashes or hangs would fail its whole batch."""
    ground_truth = make_episode(n_steps=2, nodes=4, images=True)
    whole, flipped = write_session(tmp_path / "one.h5", [ground_truth]).read_bytes(), tmp_path / "flipped.h5"

    def batch(rng):
        results = []
        for _ in range(per_batch):
            flipped.write_bytes(_flip(rng, whole))
            results.append((read(flipped), len(violations(flipped))))
        return results

    def read(file):
        try:
            return [differences(episode, ground_truth) for episode in _read(file)]
        except DataError as error:
            return str(error)

    noticed = 0
    for seed in range(batches):
        work = functools.partial(batch, random.Random(seed))
        for result, count in call_in_sandbox(work, limit_s=100, memory_bytes=1 << 30):
            assert (count and "\n" not in result) if isinstance(result, str) else result == [[]]
            noticed += count > 0
    assert noticed > batches * per_batch / 2, "only what HDF5 leaves unused may go unnoticed"


def _attribute(key, value, where="data/demo_0"):
    return lambda f: f[where].attrs.__setitem__(key, value)


def _remade(key, **how):
    def change(f):
        del f[key]
        f.create_dataset(key, **how)

    return change


def _linked(key, link):
    def change(f):
        del f[key]
        f[key] = link

    return change


def _external_bytes(f):
    del f["data/demo_0/rewards"]
    f["data/demo_0"].create_dataset("rewards", (3,), "<f8", external=[("/dev/zero", 0, 24)])


WRONG = {
    "million rows": (_remade("data/demo_0/rewards", shape=(10**6,), dtype="<f8", chunks=(100,)), "rewards"),
    "a shape that no memory holds": (
        _remade("data/demo_0/states", shape=(3, 3 * 10**14), dtype="<f8", chunks=(1, 1000)),
        "states",
    ),
    "a chunk that no memory holds": (
        _remade("data/demo_0/states", shape=(3, 12), maxshape=(None, 12), dtype="<f8", chunks=(40_000_000, 12)),
        "states",
    ),
    "soft link": (_linked("data/demo_0/obs", h5py.SoftLink("/data/demo_1/obs")), "demo_0/obs"),
    "external link": (_linked("data/demo_0/obs/word", h5py.ExternalLink("PIPE", "/x")), "obs/word"),
    "external demo": (_linked("data/demo_1", h5py.ExternalLink("PIPE", "/x")), "demo_1"),
    "external mask": (_linked("mask/all", h5py.ExternalLink("PIPE", "/x")), "/mask"),
    "external index": (_linked("index", h5py.ExternalLink("PIPE", "/x")), "index"),
    "external bytes": (_external_bytes, "rewards"),
    "seed as text": (_attribute("seed", "5"), "demo_0@seed"),
    "seed as array": (_attribute("seed", np.arange(10**4)), "demo_0@seed"),
    "seed changed": (_attribute("seed", 5), "demo_0@attributes_sha256"),
    "total": (_attribute("total", 7, "data"), "/data@total"),
    "nan": (lambda f: f["data/demo_0/obs/word"].write_direct(np.full((3, 2), np.nan)), "obs/word"),
    "not of unit length": (lambda f: f["data/demo_0/obs/word"].write_direct(np.full((3, 2), 0.5)), "obs/word"),
    "action": (lambda f: f["data/demo_0/actions"].write_direct(np.full((3, 2), 1.5)), "actions"),
    "done": (lambda f: f["data/demo_0/dones"].write_direct(np.zeros(3, "u1")), "dones"),
    "time": (lambda f: f["data/demo_0/obs/time_s"].write_direct(np.zeros((3, 1))), "time_s"),
    "reward": (lambda f: f["data/demo_0/rewards"].write_direct(np.ones(3)), "rewards"),
    "phase": (lambda f: f["data/demo_0/phase"].write_direct(np.array([b"x"] * 3, "S8")), "phase"),
    "next image": (lambda f: f["data/demo_0/next_obs/rgb"].__setitem__(0, 0), "next_obs/rgb"),
    "mask": (_remade("mask/success", data=np.array([b"demo_7"])), "/mask/success"),
    "mask of ours": (_remade("mask/all", data=np.array([b"demo_0"])), "/mask/all"),
    "index": (_remade("index", data=np.zeros(100, "u1")), "/index"),
    "stranger": (lambda f: f["data"].create_group("extra"), "/data/extra"),
}


@pytest.mark.parametrize(("change", "where"), WRONG.values(), ids=WRONG.keys())
def test_what_is_wrong_is_said_with_its_place(path, tmp_path, monkeypatch, change, where):
    """PIPE is a pipe that nobody writes to: whoever opened it would wait for ever."""
    os.mkfifo(tmp_path / "PIPE")
    monkeypatch.chdir(tmp_path)
    with h5py.File(path, "r+") as f:
        change(f)
    began = time.monotonic()
    found = validate(path)
    assert time.monotonic() - began < 20
    assert any(where in violation.path for violation in found), found
    assert all("\n" not in violation.message for violation in found)


def test_all_that_is_wrong_is_said_at_once(path):
    with h5py.File(path, "r+") as f:
        for key in ("seed", "wall_s"):
            f["data/demo_0"].attrs[key] = "x"
        del f["data/demo_1/rewards"]
        f["data/demo_1/obs/word"][0] = np.nan
        f["data"].attrs["total"] = 1
    found = {violation.path for violation in validate(path)}
    assert {"/data/demo_0@seed", "/data/demo_0@wall_s", "/data/demo_1/rewards"} <= found


@pytest.mark.parametrize("content", [b"", b"x", b"\x89HDF\r\n\x1a\n", b"PK\x03\x04" * 100, bytes(4096)])
def test_what_is_no_session(tmp_path, content):
    (tmp_path / "s.h5").write_bytes(content)
    assert len(validate(tmp_path / "s.h5")) == 1


def test_missing_folder_foreign_and_newer(tmp_path):
    with h5py.File(tmp_path / "foreign.h5", "w") as f:
        f["x"] = np.arange(3)
    for name, words in (("none.h5", "does not exist"), ("", "is not a file"), ("foreign.h5", "another program")):
        (violation,) = validate(tmp_path / name)
        assert words in violation.message


def test_episodes_that_wait_beside_the_file_are_checked_too(path):
    folder = parts_folder(path)
    folder.mkdir()
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2 : len(damaged) // 2 + 2000] = bytes(2000)
    (folder / "demo_5.h5").write_bytes(damaged)
    found = validate(path)
    assert found
    assert all(violation.path.startswith("demo_5.h5:") for violation in found)
    (folder / f"demo_6.h5{PART_SUFFIX}").write_bytes(b"half")
    assert validate(path) == found


def test_a_crash_a_hang_and_a_glutton_are_held_off():
    for work, words in (
        (os.abort, "ended the process"),
        (lambda: time.sleep(60), "took more than 1 s"),
        (lambda: bytearray(1 << 34), "MemoryError"),
        (lambda: 1 / 0, "division by zero"),
    ):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(CallError, match=words):
            call_in_sandbox(work, limit_s=1, memory_bytes=1 << 28)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000
    assert call_in_sandbox(lambda: [1, 2], limit_s=10, memory_bytes=1 << 28) == [1, 2]
