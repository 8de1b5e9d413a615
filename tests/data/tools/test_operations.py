"""merge, split, filter, trim, repair: they conserve episodes, never overwrite, and leave nothing half."""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.data import SessionRecorder, filter_session, merge, open_session, repair, split, trim, validate
from layflat.data.errors import DataError
from layflat.data.session.parts import parts_folder
from layflat.data.types import DisturbanceRecord, DragTarget
from layflat.tests.factories import HANGER, PICKERS, differences, make_episode, prefix_of, write_session


def _by_uid(path):
    with open_session(path) as session:
        return {session.info(name).uid: session.episode(name) for name in session.names}


def _same(found, wanted):
    assert found.keys() == wanted.keys()
    assert [differences(found[uid], wanted[uid]) for uid in wanted] == [[]] * len(wanted)


@given(
    counts=st.lists(st.integers(1, 4), min_size=1, max_size=3),
    share=st.floats(0.2, 0.8),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=5, deadline=None, suppress_health_check=list(HealthCheck))
def test_merge_and_split_conserve(counts, share, seed):
    with tempfile.TemporaryDirectory() as name:
        folder, number, wanted = Path(name), 0, {}
        files = [folder / f"{i}.h5" for i in range(len(counts))]
        for file, count in zip(files, counts, strict=True):
            with SessionRecorder(file, robot=HANGER, cloth="towel", save_images=True) as recorder:
                for _ in range(count):
                    recorder.save(make_episode(n_steps=2, seed=number, nodes=3, images=number % 2 == 0))
                    number += 1
            wanted |= _by_uid(file)
        names = merge([*files, files[0]], folder / "all.h5")
        assert len(names) == number, "an episode that is there twice is taken once"
        _same(_by_uid(folder / "all.h5"), wanted)
        assert validate(folder / "all.h5") == ()
        if number < 2:
            return
        targets = {"train": folder / "train.h5", "valid": folder / "valid.h5"}
        shares = {"train": share, "valid": 1 - share}
        if min(share, 1 - share) * number < 1:
            return
        chosen = split(folder / "all.h5", targets, shares, seed)
        assert sorted(chosen["train"] + chosen["valid"]) == sorted(names)
        assert abs(len(chosen["train"]) - share * number) < 1
        _same(_by_uid(targets["train"]) | _by_uid(targets["valid"]), wanted)


def test_a_split_depends_on_the_seed_and_on_nothing_else(tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode(seed=seed) for seed in range(12)])
    shares = {"a": 2, "b": 1}
    chosen = [
        split(path, {key: tmp_path / f"{key}{run}.h5" for key in shares}, shares, seed)
        for run, seed in enumerate([0, 0, 1])
    ]
    assert chosen[0] == chosen[1] != chosen[2]
    assert [len(chosen[0][key]) for key in "ab"] == [8, 4]


@pytest.fixture
def mixed(tmp_path):
    outcomes, sources = ["success", "failure", "partial"], ["scripted", "gamepad"]
    made = [
        make_episode(n_steps=2 + i, seed=i, outcome=outcomes[i % 3], source=sources[i % 2], images=True)
        for i in range(7)
    ]
    return write_session(tmp_path / "mixed.h5", made), made


@pytest.mark.parametrize(
    ("conditions", "chosen"),
    [
        ({}, range(7)),
        ({"success": True}, [0, 3, 6]),
        ({"success": False}, [1, 2, 4, 5]),
        ({"source": "gamepad"}, [1, 3, 5]),
        ({"length": (4, 6)}, [2, 3, 4]),
        ({"names": ["demo_5", "demo_1"]}, [1, 5]),
        ({"success": True, "source": "scripted", "length": (0, 7)}, [0]),
        ({"cloth": "towel", "final_contact": (0.97, 0.97)}, range(7)),
    ],
)
def test_filter_keeps_what_meets_all_conditions(mixed, tmp_path, conditions, chosen):
    path, made = mixed
    names = filter_session(path, tmp_path / "f.h5", **conditions)
    assert names == tuple(f"demo_{i}" for i in chosen)
    with open_session(tmp_path / "f.h5") as session:
        assert session.names == names
        assert [differences(e, made[i]) for e, i in zip(session, chosen, strict=True)] == [[]] * len(names)
    assert validate(tmp_path / "f.h5") == ()


@pytest.mark.parametrize("conditions", [{"cloth": "silk"}, {"source": "x"}, {"length": (100, 200)}])
def test_an_empty_filter_result_is_refused(mixed, tmp_path, conditions):
    with pytest.raises(DataError, match="none of the 7 episodes"):
        filter_session(mixed[0], tmp_path / "f.h5", **conditions)
    assert [p.name for p in tmp_path.iterdir()] == ["mixed.h5"]


@pytest.mark.parametrize(("start", "stop"), [(0, 3), (1, 4), (2, 6), (0, 6)])
def test_trim(mixed, tmp_path, start, stop):
    path, made = mixed
    info = trim(path, tmp_path / "t.h5", name="demo_4", start=start, stop=stop)
    assert (info.n_steps, info.first_step) == (stop - start, start)
    with open_session(path) as before, open_session(tmp_path / "t.h5") as after:
        assert after.names == before.names
        assert [before.info(n).uid == after.info(n).uid for n in before.names].count(False) == 1
        ends = {} if stop < 6 else {"outcome": made[4].outcome, "stopped_by": made[4].stopped_by}
        cut = prefix_of(made[4], stop, **({"stopped_by": "interrupted"} | ends), first_step=start)
        found = after.episode("demo_4")
        assert differences(found.steps, cut.steps[start:]) == []
        assert differences(found.final_observation, cut.final_observation) == []
        assert (found.outcome, found.stopped_by, found.first_step) == (cut.outcome, cut.stopped_by, start)
        assert differences(after[0], made[0]) == []
    assert validate(tmp_path / "t.h5") == ()


@pytest.mark.parametrize(("start", "stop"), [(-1, 2), (2, 2), (3, 1), (0, 99)])
def test_an_impossible_trim_is_refused(mixed, tmp_path, start, stop):
    with pytest.raises(DataError, match="cannot be kept; the episode has steps 0 to 6"):
        trim(mixed[0], tmp_path / "t.h5", name="demo_4", start=start, stop=stop)
    assert not (tmp_path / "t.h5").exists()


OPERATIONS = {
    "merge": lambda path, target, **how: merge([path], target, **how),
    "split": lambda path, target, **how: split(path, {"a": target}, {"a": 1}, 0, **how),
    "filter": lambda path, target, **how: filter_session(path, target, **how),
    "trim": lambda path, target, **how: trim(path, target, name="demo_0", start=0, stop=1, **how),
    "repair": lambda path, target, **how: repair(path, target, **how),
}


@pytest.mark.parametrize("operation", OPERATIONS.values(), ids=OPERATIONS.keys())
def test_an_operation_replaces_a_file_only_with_force_and_completely(mixed, tmp_path, operation, monkeypatch):
    path, target = mixed[0], tmp_path / "t.h5"
    before = path.read_bytes()
    target.write_bytes(b"precious")
    with pytest.raises(DataError, match=r"t\.h5 exists"):
        operation(path, target)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", _full)
        with pytest.raises(DataError, match="cannot be written: No space left"):
            operation(path, target, force=True)
    assert target.read_bytes() == b"precious"
    operation(path, target, force=True)
    assert len(_by_uid(target)) == len(_by_uid(path))
    with pytest.raises(DataError, match="does not exist"):
        operation(tmp_path / "none.h5", tmp_path / "n.h5")
    with pytest.raises(DataError, match="missing does not exist"):
        operation(path, tmp_path / "missing" / "n.h5")
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mixed.h5", "t.h5"]


def _full(descriptor):
    raise OSError(28, "No space left on device")


def test_only_sessions_that_agree_are_merged(tmp_path):
    path = write_session(tmp_path / "a.h5", [make_episode()])
    for key, episode, options in (
        ("robot", make_episode(PICKERS), {}),
        ("cloth", make_episode(cloth="napkin"), {}),
        ("step_s", make_episode(step_s=0.05), {}),
        ("descriptor", make_episode(descriptor="how"), {"descriptor": "how"}),
    ):
        other = write_session(tmp_path / f"{key}.h5", [episode], **options)
        with pytest.raises(DataError, match=f"has {key} .* only sessions that agree"):
            merge([path, other], tmp_path / "m.h5")
    assert not (tmp_path / "m.h5").exists()


def test_additions_of_users_are_copied(mixed, tmp_path):
    with h5py.File(mixed[0], "r+") as f:
        f["mask/train"] = np.array([b"demo_0", b"demo_3", b"demo_4"])
        f["notes/text"] = "first take"
        f["data"].attrs["author"] = "a person"
    filter_session(mixed[0], tmp_path / "f.h5", success=True)
    merge([tmp_path / "f.h5", mixed[0]], tmp_path / "m.h5")
    with h5py.File(tmp_path / "f.h5") as f:
        assert f["mask/train"][()].tolist() == [b"demo_0", b"demo_3"]
        assert f["notes/text"][()] == b"first take"
        assert f["data"].attrs["author"] == "a person"
    with h5py.File(tmp_path / "m.h5") as f:
        # demo_3 and demo_6 became 1 and 2, then 1, 2, 4 and 5 of the other file 3 to 6.
        assert set(f["mask/train"][()].tolist()) == {b"demo_0", b"demo_1", b"demo_5"}


def test_repair_saves_intact_episodes_and_reports_the_others(mixed, tmp_path):
    path, made = mixed
    with h5py.File(path, "r+") as f:
        del f["data/demo_1/actions"]
        f["data/demo_2"].attrs["seed"] = 77
        f["data"].attrs["total"] = 1
        del f["mask/all"], f["index"]
        offset = f["data/demo_3/obs/rgb"].id.get_chunk_info(0).byte_offset
    with path.open("r+b") as file:
        file.seek(offset)
        file.write(b"\xff" * 8)
    with pytest.raises(DataError):
        open_session(path)
    report = repair(path, tmp_path / "r.h5")
    assert {loss.path for loss in report.lost} == {f"/data/demo_{i}" for i in (1, 2, 3)}
    assert report.intact == ("demo_0", "demo_4", "demo_5", "demo_6")
    assert validate(tmp_path / "r.h5") == ()
    with open_session(tmp_path / "r.h5") as session:
        assert [differences(session[f"demo_{i}"], made[i]) for i in (0, 4, 5, 6)] == [[]] * 4
    before = path.read_bytes()
    report = repair(path)
    assert report.original is not None
    assert report.original.read_bytes() == before
    assert validate(path) == ()
    again = repair(path)
    assert (again.lost, again.original) == ((), None)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mixed.h5", "mixed.h5.damaged", "r.h5"]


def test_a_session_that_is_being_recorded_is_not_repaired(tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode())
        with pytest.raises(DataError, match="being written by another program"):
            repair(path)
        with pytest.raises(DataError, match="being written by another program"):
            filter_session(path, path, force=True)
        with pytest.raises(DataError, match="being written by another program"):
            repair(path, tmp_path / "r.h5")


def test_repair_removes_the_files_of_a_killed_writer(mixed, tmp_path):
    path, folder = mixed[0], parts_folder(mixed[0])
    other = write_session(tmp_path / "other.h5", [make_episode(seed=50)])
    folder.mkdir()
    other.rename(folder / "demo_7.h5")
    (folder / "demo_8.h5.part").write_bytes(b"half an episode")
    (folder / "session.h5.part").write_bytes(b"half a session")
    report = repair(path)
    assert report.intact == tuple(f"demo_{i}" for i in range(8))
    assert [p.name for p in tmp_path.iterdir()] == ["mixed.h5"]


def test_a_damaged_part_is_set_aside(mixed, tmp_path):
    path, folder = mixed[0], parts_folder(mixed[0])
    damaged = bytearray(write_session(tmp_path / "other.h5", [make_episode(seed=50)]).read_bytes())
    (tmp_path / "other.h5").unlink()
    damaged[600:3000] = bytes(2400)
    folder.mkdir()
    (folder / "demo_7.h5").write_bytes(damaged)
    with pytest.raises(DataError, match=r"demo_7\.h5"), open_session(path) as session:
        list(session)
    report = repair(path)
    assert [loss.path for loss in report.lost] == ["mixed.h5.parts/demo_7.h5"]
    assert len(report.intact) == 7
    assert validate(path) == ()
    assert (tmp_path / "mixed.h5.damaged-demo_7.h5").read_bytes() == damaged
    assert not folder.exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to become another user")
def test_a_write_protected_session_is_repaired_elsewhere(mixed):
    folder = Path(tempfile.mkdtemp(dir="/tmp"))
    try:
        (folder / "s.h5").write_bytes(mixed[0].read_bytes())
        (folder / "s.h5").chmod(0o444)
        (folder / "out").mkdir()
        (folder / "out").chmod(0o777)
        folder.chmod(0o555)
        child = os.fork()
        if child == 0:
            os.setuid(65534)
            os._exit(len(repair(folder / "s.h5", folder / "out" / "r.h5").intact) != 7)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        assert [p.name for p in folder.iterdir() if p.suffix] == ["s.h5"]
    finally:
        shutil.rmtree(folder)


def test_disturbances_are_counted_from_the_trimmed_start(tmp_path):
    """Of three disturbances in the steps 1 to 2, 4 to 6, and from 8 on."""
    lasting = [(1, 2), (4, 6), (8, None)]
    disturbances = [DisturbanceRecord(name=str(n), first_step=a, last_step=b) for n, (a, b) in enumerate(lasting)]
    path = write_session(tmp_path / "s.h5", [make_episode(n_steps=10, disturbances=disturbances)])
    for (start, stop), wanted in {
        (0, 10): [("0", 1, 2), ("1", 4, 6), ("2", 8, None)],
        (3, 10): [("1", 1, 3), ("2", 5, None)],
        (5, 9): [("1", 0, 1), ("2", 3, None)],
        (0, 6): [("0", 1, 2), ("1", 4, None)],
        (7, 8): [],
    }.items():
        trim(path, tmp_path / "t.h5", name="demo_0", start=start, stop=stop, force=True)
        with open_session(tmp_path / "t.h5") as session:
            assert [(r.name, r.first_step, r.last_step) for r in session[0].disturbances] == wanted


def test_optional_columns_are_absent_where_no_step_has_any(tmp_path):
    plain, pulled = make_episode(n_steps=4), make_episode(n_steps=4, seed=1)
    steps = [
        *pulled.steps[:3],
        replace(pulled.steps[3], drag=DragTarget(node=2, target_m=[0, 0, 0.1]), force_n=[0, 0, 2.0]),
    ]
    path = write_session(tmp_path / "s.h5", [plain, replace(pulled, steps=steps)])
    with h5py.File(path) as f:
        assert not {"force_n", "drag_node", "drag_target_m", "intervention", "hand_m"} & set(f["data/demo_0"])
        assert {"force_n", "drag_node", "drag_target_m"} <= set(f["data/demo_1"])
    with open_session(path) as session:
        rows = session.arrays(["force_n", "drag_node", "drag_target_m", "intervention"])
    assert rows["force_n"].tolist() == [[0, 0, 0]] * 7 + [[0, 0, 2]]
    assert rows["drag_node"].tolist() == [-1] * 7 + [2]
    assert np.isnan(rows["drag_target_m"][:7]).all()
    assert rows["drag_target_m"][7].tolist() == [0, 0, 0.1]
    assert not rows["intervention"].any()
