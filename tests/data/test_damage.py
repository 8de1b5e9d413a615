"""Missing, foreign, cut short, damaged or hostile files: one sentence each, and nothing is touched or hangs."""

from __future__ import annotations

import functools
import json
import os
import random
import resource
import time

import h5py
import numpy as np
import pytest

from layflat.data import SessionRecorder, open_session, repair, validate
from layflat.data.atomic_files import PART_SUFFIX
from layflat.data.errors import DataError
from layflat.data.sandbox import CallError, call_in_sandbox
from layflat.data.session.parts import parts_folder
from layflat.data.tools.validate import violations
from layflat.tests.factories import HANGER, PICKERS, differences, make_episode, write_session

NO_SESSIONS = [b"", b"x", b"\x89HDF\r\n\x1a\n", b"PK\x03\x04" * 100, bytes(4096), b"seed,word\n"]


@pytest.fixture
def path(tmp_path):
    """A session of two episodes of three steps and four nodes, with images."""
    episodes = [make_episode(n_steps=3, seed=seed, nodes=4, images=True) for seed in range(2)]
    return write_session(tmp_path / "s.h5", episodes)


def _read(path):
    with open_session(path) as session:
        return list(session)


def _refused(path, match=None):
    """Reading fails with one sentence, which names the file."""
    with pytest.raises(DataError, match=match) as caught:
        _read(path)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


# Files and folders


def test_a_missing_file_or_a_folder_is_refused(tmp_path):
    (tmp_path / "loop.h5").symlink_to(tmp_path / "nowhere.h5")
    for path, message in (
        (tmp_path / "none.h5", "does not exist"),
        (tmp_path, "is not a file"),
        (tmp_path / "loop.h5", "does not exist"),
        (tmp_path / ("x" * 300), "cannot be read: File name too long"),
    ):
        _refused(path, message)
    for path, message in ((tmp_path / "none.h5", "does not exist"), (tmp_path, "is not a file")):
        (violation,) = validate(path)
        assert message in violation.message


def test_a_refused_file_is_closed_again(path):
    with h5py.File(path, "r+") as f:
        del f["data/demo_1/actions"]
    _refused(path, "demo_1 has no data set actions")
    with h5py.File(path, "r+"):
        pass  # HDF5 would refuse if a reader still held it.


@pytest.mark.parametrize("content", NO_SESSIONS)
def test_other_bytes_are_refused_and_not_touched(tmp_path, content):
    path = tmp_path / "s.h5"
    path.write_bytes(content)
    _refused(path)
    assert len(validate(path)) == 1
    with pytest.raises(DataError):
        SessionRecorder(path, robot=HANGER, cloth="towel")
    with pytest.raises(DataError, match="holds no episode that can be read"):
        repair(path)
    assert path.read_bytes() == content
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


ROBOMIMIC = {"total": 2, "env_args": json.dumps({"type": 1, "env_name": "Lift", "env_kwargs": {}})}
FOREIGN = {
    "robomimic": (ROBOMIMIC, "another program"),
    "a newer version": ({"schema": np.bytes_("layflat-episodes"), "schema_version": 99}, "version 99.*version 1"),
    "unreleased version 1": ({"schema": "layflat-session", "schema_version": 1}, "unreleased version.*record it again"),
    "unreleased version 3": (
        {"schema": np.bytes_("layflat-session"), "schema_version": 3},
        "unreleased version.*record it again",
    ),
}


@pytest.mark.parametrize(("attributes", "message"), FOREIGN.values(), ids=FOREIGN.keys())
def test_foreign_and_unreleased_files_are_refused_and_not_touched(tmp_path, attributes, message):
    path = tmp_path / "s.h5"
    with h5py.File(path, "w") as f:
        f["data/demo_0/actions"] = np.zeros((2, 2))
        f["data"].attrs.update(attributes)
    before = path.read_bytes()
    _refused(path, message)
    with pytest.raises(DataError, match=message):
        SessionRecorder(path, robot=HANGER, cloth="towel")
    with pytest.raises(DataError, match=message):
        repair(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


def test_appended_episodes_must_agree(path):
    before = path.read_bytes()
    for options, message in (
        ({"robot": PICKERS, "cloth": "towel"}, "has robot hanger, not pickers"),
        ({"robot": HANGER, "cloth": "napkin"}, "has cloth towel, not napkin"),
        ({"robot": HANGER, "cloth": "towel", "task": "smooth"}, "has task place, not smooth"),
        ({"robot": HANGER, "cloth": "towel", "descriptor": "how"}, "has descriptor word, not how"),
        ({"robot": "fold", "cloth": "towel"}, "robot is 'fold'; it must be a RobotSpec"),
    ):
        with pytest.raises(DataError, match=message):
            SessionRecorder(path, **options)
    with (
        SessionRecorder(path, robot=HANGER, cloth="towel") as recorder,
        pytest.raises(DataError, match=r"step_s is 0\.05"),
    ):
        recorder.save(make_episode(step_s=0.05))
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]


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
def test_write_protected_files_are_refused(tmp_path, path):
    path.chmod(0o444)
    with pytest.raises(DataError, match="write-protected"):
        SessionRecorder(path, robot=HANGER, cloth="towel")
    tmp_path.chmod(0o555)
    with pytest.raises(DataError, match="Permission denied"):
        SessionRecorder(tmp_path / "new.h5", robot=HANGER, cloth="towel")
    tmp_path.chmod(0o755)


# Damaged bytes


def test_a_file_cut_short_is_noticed_and_repaired_truly(path, tmp_path):
    whole, cut, mended = path.read_bytes(), tmp_path / "cut.h5", tmp_path / "mended.h5"
    episodes, rng = {episode.seed: episode for episode in _read(path)}, random.Random(0)

    def everything():
        found = []
        for work in (lambda: _read(cut), lambda: repair(cut, mended, force=True)):
            try:
                found.append(work())
            except DataError as error:
                found.append(str(error))
        return [violations(cut), *found]

    lengths = [1, 7, 8, 9, 47, 48, len(whole) - 1, *range(0, len(whole), 4096)]
    for length in [*lengths, *(rng.randrange(len(whole)) for _ in range(20))]:
        cut.write_bytes(whole[:length])
        check, read, repaired = call_in_sandbox(everything, limit_s=60, memory_bytes=1 << 30)
        assert check
        assert isinstance(read, str)
        assert "\n" not in read
        if not isinstance(repaired, str):
            assert validate(mended) == ()
            assert all(differences(episode, episodes[episode.seed]) == [] for episode in _read(mended))


@pytest.mark.parametrize(("missing", "least"), [(1, 6), (64, 6), (600, 1)])
def test_a_file_without_its_last_bytes_is_repaired(tmp_path, missing, least):
    episodes = [make_episode(n_steps=4, seed=seed) for seed in range(6)]
    path = write_session(tmp_path / "long.h5", episodes)
    path.write_bytes(path.read_bytes()[:-missing])
    with pytest.raises(DataError):
        open_session(path)
    report = repair(path)
    assert len(report.intact) >= least
    assert (len(report.intact) < 6) == bool(report.lost)
    assert validate(path) == ()
    assert all(differences(episode, episodes[episode.seed]) == [] for episode in _read(path))


@pytest.mark.parametrize(
    ("batches", "per_batch"),
    [(2, 60), pytest.param(20, 100, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])],
    ids=["few", "many"],
)
def test_a_wrong_bit_is_never_read_as_something_else(tmp_path, batches, per_batch):
    """In batches that share a process, for speed; one that crashes or hangs would fail its whole batch."""
    episode, flipped = make_episode(n_steps=2, nodes=4, images=True), tmp_path / "flipped.h5"
    whole = write_session(tmp_path / "one.h5", [episode]).read_bytes()

    def batch(rng):
        results = []
        for _ in range(per_batch):
            damaged = bytearray(whole)
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
            flipped.write_bytes(damaged)
            results.append((read(flipped), len(violations(flipped))))
        return results

    def read(file):
        try:
            return [differences(found, episode) for found in _read(file)]
        except DataError as error:
            return str(error)

    noticed = 0
    for seed in range(batches):
        work = functools.partial(batch, random.Random(seed))
        for result, count in call_in_sandbox(work, limit_s=100, memory_bytes=1 << 30):
            assert (count and "\n" not in result) if isinstance(result, str) else result == [[]]
            noticed += count > 0
    assert noticed > batches * per_batch / 2, "only what HDF5 leaves unused may go unnoticed"


# Changed, missing and hostile members


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


def _values(key, values):
    return lambda f: f[f"data/demo_0/{key}"].write_direct(values)


def _external_bytes(f):
    del f["data/demo_0/rewards"]
    f["data/demo_0"].create_dataset("rewards", (3,), "<f8", external=[("/dev/zero", 0, 24)])


def _virtual(f):
    layout = h5py.VirtualLayout((3, 2), "<f8")
    layout[:] = h5py.VirtualSource("/etc/hostname.h5", "x", (3, 2))
    del f["data/demo_0/actions"]
    f["data/demo_0"].create_virtual_dataset("actions", layout)


def _huge_and_long(f):
    _remade("data/demo_0/states", shape=(3, 3 * 10**11), dtype="<f8", chunks=(1, 1000))(f)
    f["data/demo_0"].attrs["num_samples"] = 10**12


def _not_three_per_node(f):
    _remade("data/demo_0/states", data=np.zeros((3, 4)))(f)
    _remade("data/demo_0/ground_truth/final_state", data=np.zeros(4))(f)


DEMO = "data/demo_0"
PIPE = h5py.ExternalLink("PIPE", "/x")
"""A pipe without a writer: a program that opens it waits for ever."""
WRONG = {
    "float32 actions": (_remade(f"{DEMO}/actions", data=np.zeros((3, 2), "<f4")), "actions"),
    "text actions": (_remade(f"{DEMO}/actions", data=np.zeros((3, 2), "S3")), "actions"),
    "python objects": (_remade(f"{DEMO}/phase", data=["a", "b", "c"], dtype=h5py.string_dtype()), "phase"),
    "empty data space": (_remade(f"{DEMO}/actions", data=h5py.Empty("<f8")), "actions"),
    "three columns": (_remade(f"{DEMO}/actions", data=np.zeros((3, 3))), "actions"),
    "fewer rows": (_remade(f"{DEMO}/obs/word", data=np.zeros((2, 2))), "obs/word"),
    "million rows": (_remade(f"{DEMO}/rewards", shape=(10**6,), dtype="<f8", chunks=(100,)), "rewards"),
    "another node count": (_remade(f"{DEMO}/ground_truth/final_state", data=np.zeros(9)), "final_state"),
    "not three per node": (_not_three_per_node, "states"),
    "a hand of another robot": (_remade(f"{DEMO}/hand_m", data=np.zeros((3, 2, 3))), "hand_m"),
    "a shape that no memory holds": (
        _remade(f"{DEMO}/states", shape=(3, 3 * 10**14), dtype="<f8", chunks=(1, 1000)),
        "states",
    ),
    "a chunk that no memory holds": (
        _remade(f"{DEMO}/states", shape=(3, 12), maxshape=(None, 12), dtype="<f8", chunks=(40_000_000, 12)),
        "states",
    ),
    "all huge": (_huge_and_long, "demo_0"),
    "group for data set": (lambda f: (f.pop(f"{DEMO}/rewards"), f.create_group(f"{DEMO}/rewards")), "rewards"),
    "data set for group": (_remade(f"{DEMO}/ground_truth", data=np.zeros(3)), "ground_truth"),
    "rgb in obs only": (lambda f: f.pop(f"{DEMO}/next_obs/rgb"), "obs/rgb"),
    "virtual": (_virtual, "actions"),
    "soft link": (_linked(f"{DEMO}/obs", h5py.SoftLink("/data/demo_1/obs")), "demo_0/obs"),
    "external link": (_linked(f"{DEMO}/obs/word", PIPE), "obs/word"),
    "external demo": (_linked("data/demo_1", PIPE), "demo_1"),
    "linked demo": (_linked("data/demo_1", h5py.SoftLink("/data/demo_0")), "demo_1"),
    "linked data": (lambda f: (f.move("data", "d"), f.__setitem__("data", h5py.SoftLink("/d"))), "/"),
    "external bytes": (_external_bytes, "rewards"),
    "demo number": (lambda f: f["data"].create_group("demo_x"), "/data/demo_x"),
    "stranger": (lambda f: f["data"].create_group("extra"), "/data/extra"),
    "seed as text": (_attribute("seed", "5"), "demo_0@seed"),
    "seed as array": (_attribute("seed", np.arange(10**4)), "demo_0@seed"),
    "seed changed": (_attribute("seed", 5), "demo_0@attributes_sha256"),
    "no uid": (lambda f: f[DEMO].attrs.__delitem__("uid"), "demo_0@uid"),
    "no flat area": (lambda f: f[DEMO].attrs.__delitem__("flat_area_final"), "demo_0@flat_area_final"),
    "total": (_attribute("total", 7, "data"), "/data@total"),
    "total as array": (_attribute("total", np.arange(3), "data"), "/data"),
    "another robot": (_attribute("robot", np.bytes_("pickers"), "data"), "@robot"),
    "broken axes": (_attribute("action_axes", np.bytes_("[]"), "data"), "/data"),
    "another step": (_attribute("step_s", 0.2, "data"), "@step_s"),
    "another action limit": (_attribute("action_limit_m", 0.05, "data"), "/data"),
    "schema as array": (_attribute("schema", ["layflat-episodes"] * 2, "data"), "/data"),
    "nan": (_values("obs/word", np.full((3, 2), np.nan)), "obs/word"),
    "unequal actions": (_values("actions", np.full((3, 2), 0.5)), "demo_0"),
    "phase": (_values("phase", np.array([b"x"] * 3, "S8")), "phase"),
}
"""Changes that reading refuses, and the place that validate names."""
ONLY_VALIDATED = {
    "external mask": (_linked("mask/all", PIPE), "/mask"),
    "external index": (_linked("index", PIPE), "index"),
    "not of unit length": (_values("obs/word", np.full((3, 2), 0.5)), "obs/word"),
    "action": (_values("actions", np.full((3, 2), 1.5)), "actions"),
    "done": (_values("dones", np.zeros(3, "u1")), "dones"),
    "time": (_values("obs/time_s", np.zeros((3, 1))), "time_s"),
    "reward": (_values("rewards", np.ones(3)), "rewards"),
    "next image": (lambda f: f[f"{DEMO}/next_obs/rgb"].__setitem__(0, 0), "next_obs/rgb"),
    "mask": (_remade("mask/success", data=np.array([b"demo_7"])), "/mask/success"),
    "mask of ours": (_remade("mask/all", data=np.array([b"demo_0"])), "/mask/all"),
    "index": (_remade("index", data=np.zeros(100, "u1")), "/index"),
}


@pytest.mark.parametrize("name", [*WRONG, *ONLY_VALIDATED])
def test_what_is_wrong_is_reported_with_its_place(path, tmp_path, monkeypatch, name):
    change, where = (WRONG | ONLY_VALIDATED)[name]
    os.mkfifo(tmp_path / "PIPE")
    monkeypatch.chdir(tmp_path)
    with h5py.File(path, "r+") as f:
        if name.startswith("a hand"):
            f[f"{DEMO}/hand_m"] = np.zeros((3, 3))
        change(f)
    started = time.monotonic()
    if name in WRONG:
        _refused(path)
    found = validate(path)
    assert time.monotonic() - started < 20
    assert any(where in violation.path for violation in found), found
    assert all("\n" not in violation.message for violation in found)


def test_all_that_is_wrong_is_reported_at_once(path):
    assert validate(path) == ()
    with h5py.File(path, "r+") as f:
        for key in ("seed", "wall_s"):
            f["data/demo_0"].attrs[key] = "x"
        del f["data/demo_1/rewards"]
        f["data/demo_1/obs/word"][0] = np.nan
        f["data"].attrs["total"] = 1
    found = {violation.path for violation in validate(path)}
    assert {"/data/demo_0@seed", "/data/demo_0@wall_s", "/data/demo_1/rewards"} <= found


def test_parts_are_validated_too(path):
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


def test_the_sandbox_survives_crashes_hangs_and_huge_requests():
    for work, message in (
        (os.abort, "ended the process"),
        (lambda: time.sleep(60), "took more than 1 s"),
        (lambda: bytearray(1 << 34), "MemoryError"),
        (lambda: 1 / 0, "division by zero"),
    ):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(CallError, match=message):
            call_in_sandbox(work, limit_s=1, memory_bytes=1 << 28)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000
    assert call_in_sandbox(lambda: [1, 2], limit_s=10, memory_bytes=1 << 28) == [1, 2]
