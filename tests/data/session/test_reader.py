"""Session as a small library: lazy sequence, arrays, index, statistics; and readers in odd places."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest

from layflat.data import SessionRecorder, open_session, session_stats, validate
from layflat.data.errors import DataError
from layflat.data.format.encode import LIBVER
from layflat.data.format.schema import SCHEMA_VERSION
from layflat.data.session.session_writer import SessionFile
from layflat.data.types import DESCRIPTORS
from layflat.perception.descriptors import registry
from layflat.tests.factories import HANGER, differences, make_episode, write_session


@pytest.fixture
def made():
    return [make_episode(n_steps=2 + i, seed=i, images=i < 2, with_std=True) for i in range(6)]


@pytest.fixture
def path(made, tmp_path):
    return write_session(tmp_path / "s.h5", made)


def test_a_session_is_a_lazy_sequence(path, made):
    with open_session(path) as session:
        assert len(session) == len(made)
        for which in (0, 5, -1, -6):
            assert differences(session[which], made[which]) == []
        assert differences(session["demo_2"], made[2]) == []
        for which in (slice(1, 4), slice(None, None, -2), slice(9, 12)):
            view = session[which]
            assert [differences(a, b) for a, b in zip(view, made[which], strict=True)] == [[]] * len(made[which])
        assert "demo_5" in session
        assert "demo_6" not in session
        assert session[1:5][1:3].names == ("demo_2", "demo_3")
        assert differences(session[1:5][-1], made[4]) == []
        view = session.view(["demo_1", "demo_0"], images=False)
        assert [episode.seed for episode in view] == [1, 0]
        assert all(o.rgb is None for episode in view for o in episode.observations())
        for which in (6, -7):
            with pytest.raises(IndexError):
                session[which]
        for name in ("demo_6", "x"):
            with pytest.raises(DataError, match="has no episode"):
                session.view([name])


def test_arrays_are_the_steps_one_after_another(path, made):
    names = ["demo_4", "demo_1"]
    chosen = [made[4], made[1]]
    with open_session(path) as session:
        found = session.arrays(["obs/word", "action_m", "next_obs/contact_portion", "states"], names)
        assert session[4:0:-3].arrays(["action_m"])["action_m"].tobytes() == found["action_m"].tobytes()
    steps = [step for episode in chosen for step in episode.steps]
    np.testing.assert_array_equal(found["obs/word"], [step.observation.word for step in steps])
    np.testing.assert_array_equal(found["action_m"], [step.action for step in steps])
    np.testing.assert_array_equal(found["states"], [step.ground_truth.nodes.ravel() for step in steps])
    np.testing.assert_array_equal(
        found["next_obs/contact_portion"][:, 0], [c for episode in chosen for c in episode.contact()[1:]]
    )
    np.testing.assert_array_equal(found["episode"], [i for i, e in enumerate(chosen) for _ in e.steps])
    np.testing.assert_array_equal(found["step"], [t for e in chosen for t in range(len(e.steps))])


def test_rows_of_one_episode_and_unknown_keys(path, made):
    with open_session(path) as session:
        rows = session.array("demo_1", "obs/rgb", slice(1, 3))
        np.testing.assert_array_equal(rows, [step.observation.rgb for step in made[1].steps[1:3]])
        with pytest.raises(DataError, match="was recorded without obs/rgb"):
            session.array("demo_3", "obs/rgb")
        with pytest.raises(DataError, match="'obs/x' is no data set"):
            session.array("demo_3", "obs/x")
        with pytest.raises(DataError, match="has no row per step"):
            session.arrays(["ground_truth/final_state"])
        assert session.arrays(["action_m"], []).keys() == {"episode", "step"}


def test_infos_agree_with_the_episodes(path):
    with open_session(path) as session:
        for name, info in session.infos().items():
            episode = session.episode(name)
            assert (info.n_steps, info.seed, info.source) == (len(episode.steps), episode.seed, episode.source)
            assert (info.contact_start, info.contact_final) == tuple(episode.contact()[[0, -1]])
            assert info.contact_final_true == episode.final_ground_truth.contact_portion_true
            assert info.flat_area_final == episode.final_ground_truth.flat_area
            assert info.images == (episode.steps[0].observation.rgb is not None)
            assert info.created_utc == episode.provenance.created_utc
            assert info.duration_s == pytest.approx(len(episode.steps) * 0.1)


def _without_index(f):
    del f["index"]


def _fewer(f):
    total = f["data"].attrs["total"] - f["data/demo_3"].attrs["num_samples"]
    del f["data/demo_3"]
    f["data"].attrs["total"] = total


def _wrong_row(f):
    text = bytes(f["index"][()]).replace(b'"n_steps":4', b'"n_steps":"4"')
    del f["index"]
    f["index"] = np.frombuffer(text, np.uint8)


@pytest.mark.parametrize("change", [_without_index, _fewer, _wrong_row])
def test_an_unusable_index_is_ignored(path, made, change):
    with h5py.File(path, "r+") as f:
        change(f)
    wanted = [e for i, e in enumerate(made) if change is not _fewer or i != 3]
    with open_session(path) as session:
        assert not session.catalog.indexed
        assert [differences(a, b) for a, b in zip(session, wanted, strict=True)] == [[]] * len(wanted)
    with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
        recorder.save(make_episode(seed=77))
    with open_session(path) as session:
        assert session.catalog.indexed
        assert len(session) == len(wanted) + 1
    if change is not _fewer:
        assert validate(path) == ()


def test_a_wrong_index_is_noticed_when_the_episode_is_read(path):
    with h5py.File(path, "r+") as f:
        text = bytes(f["index"][()]).replace(b'"seed":3', b'"seed":8')
        del f["index"]
        f["index"] = np.frombuffer(text, np.uint8)
    with open_session(path) as session:
        assert session.info("demo_3").seed == 8
        assert session["demo_2"].seed == 2
        for use in (session.episode, session.attributes, lambda name: session.arrays(["action_m"], [name])):
            with pytest.raises(DataError, match="demo_3 does not agree with the file's index"):
                use("demo_3")
    assert [violation.path for violation in validate(path)] == ["/index"]


def test_every_data_set_has_unit_frame_and_columns(path):
    with h5py.File(path) as f:
        frames = json.loads(f["data"].attrs["frames"])
        items = []
        f["data"].visititems(lambda name, item: items.append(item) if isinstance(item, h5py.Dataset) else None)
        for item in items:
            unit, frame, columns = (item.attrs[key] for key in ("unit", "frame", "columns"))
            assert unit in ("1", "m", "s", "rad")
            assert frame in frames
            columns = json.loads(columns)
            assert not columns or len(columns) == item.shape[-1]
        units = {item.name.rpartition("/")[2]: item.attrs["unit"] for item in items}
        assert units["action_m"] == units["depth"] == units["states"] == "m"
        assert json.loads(f["data/demo_0/action_m"].attrs["columns"]) == ["dx", "dz"]
        assert f["data"].attrs["schema_version"] == SCHEMA_VERSION


def test_the_descriptors_are_those_of_perception():
    assert set(DESCRIPTORS) == set(registry.DESCRIPTORS)


def test_statistics_are_those_of_all_rows_together(path, made):
    with open_session(path) as session:
        stats = session_stats(session)
        rows = session.arrays(["action_m", "obs/contact_portion"])
    assert (stats.episodes, stats.n_steps) == (6, sum(len(e.steps) for e in made))
    assert (stats.outcomes, stats.sources) == ({"success": 6}, {"scripted": 6})
    assert stats.lengths.tolist() == [len(e.steps) for e in made]
    for key in ("action_m", "obs/contact_portion"):
        column = stats.columns[key]
        assert column.count == stats.n_steps
        np.testing.assert_array_equal(column.min, rows[key].min(axis=0))
        np.testing.assert_array_equal(column.max, rows[key].max(axis=0))
        np.testing.assert_allclose(column.mean, rows[key].mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(column.std, rows[key].std(axis=0), rtol=1e-9)
    assert not any("rgb" in key or "next_obs" in key for key in stats.columns)


def test_memory_stays_flat_while_iterating(tmp_path):
    episode = make_episode(n_steps=8, nodes=400)
    path = tmp_path / "s.h5"
    with h5py.File(path, "x", libver=LIBVER) as file:
        session = SessionFile(file)
        for number in range(24):
            session.add(f"demo_{number}", episode, f"{number:032x}")
        session.finish()
    peaks = []
    with open_session(path) as session:
        tracemalloc.start()
        for number, _ in enumerate(session):
            if number in (7, 23):
                peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 100_000, "sixteen episodes are 1.2 MB"


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to become another user")
def test_a_write_protected_folder_can_be_read(path, made):
    """As another user: reading works and leaves nothing; recording and repair are refused at once, in one sentence."""
    folder = Path(tempfile.mkdtemp(dir="/tmp"))
    try:
        shutil.copy(path, folder / "s.h5")
        folder.chmod(0o555)
        (folder / "s.h5").chmod(0o444)
        status = os.fork()
        if status == 0:
            os._exit(_without_permissions(folder / "s.h5", made))
        assert os.waitstatus_to_exitcode(os.waitpid(status, 0)[1]) == 0
        assert [p.name for p in folder.iterdir()] == ["s.h5"]
    finally:
        shutil.rmtree(folder)


def _without_permissions(path, made) -> int:
    """How many of the expectations failed; runs in a child."""
    os.setgid(65534)
    os.setuid(65534)
    failed = 0
    with open_session(path) as session:
        failed += [differences(a, b) for a, b in zip(session, made, strict=True)] != [[]] * len(made)
    failed += validate(path) != ()
    for target, word in ((path, "write-protected"), (path.with_name("new.h5"), "Permission denied")):
        try:
            SessionRecorder(target, robot=HANGER, cloth="towel").close()
        except DataError as error:
            failed += word not in str(error)
        else:
            failed += 1
    return failed
