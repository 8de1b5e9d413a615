"""Episodes of a real robot, which have no ground truth, go through everything that files and exchange do."""

from __future__ import annotations

import csv
from dataclasses import replace

import h5py
import numpy as np
import pytest

from layflat.data import SessionRecorder, merge, open_session, repair, session_stats, trim, validate
from layflat.data.errors import DataError
from layflat.data.exchange.csv_export import EPISODES_CSV, STEPS_CSV, export_csv
from layflat.data.exchange.lerobot import TaskEpisodes, export_lerobot
from layflat.data.exchange.robomimic import export_robomimic, import_robomimic
from layflat.data.session.journal_reader import read_journal
from layflat.tests.factories import (
    HANGER,
    ROBOT_SPECS,
    differences,
    initial_of,
    make_episode,
    prefix_of,
    without_ground_truth,
    write_session,
)

REAL = [without_ground_truth(make_episode(seed=seed, images=True)) for seed in range(3)]


@pytest.fixture
def path(tmp_path):
    return write_session(tmp_path / "s.h5", REAL)


def _same(path, episodes):
    assert validate(path) == ()
    with open_session(path) as session:
        assert [differences(a, b) for a, b in zip(session, episodes, strict=True)] == [[]] * len(episodes)


def test_it_is_recorded_and_read_back(path):
    _same(path, REAL)
    with open_session(path) as session:
        info = session.info("demo_0")
        assert info.contact_final_true is info.flat_area_final is None
        assert info.contact_final == REAL[0].contact()[-1]
        assert (session.physics, session[0].final_ground_truth) == ("real", None)
        with pytest.raises(DataError, match="no ground truth"):
            session[0].ground_truths()
        with pytest.raises(DataError, match="recorded without states"):
            session.arrays(["states"])
        stats = session_stats(session)
        assert np.isnan(stats.flat_area_final).all()
        assert "states" not in stats.columns
    with h5py.File(path) as file:
        assert not {"states", "ground_truth"} & set(file["data/demo_0"])


def test_it_is_recovered_from_its_journal(tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
        handle = recorder.new_journal()
        journal = handle.open(initial_of(REAL[0]))
        for step in REAL[0].steps:
            journal.step(step)
        with pytest.raises(DataError, match="started with"):
            journal.step(make_episode(images=True).steps[0])
        journal.close()
        found = read_journal(handle.path).episode
        assert differences(found, prefix_of(REAL[0], 4, wall_s=found.wall_s)) == []
        assert recorder.recover(handle).outcome == "partial"
    assert validate(path) == ()


def test_it_is_repaired_merged_and_trimmed(path, tmp_path):
    with h5py.File(path, "r+") as file:
        del file["index"]
        file["data"].attrs["total"] = 1
    assert len(repair(path).intact) == 3
    _same(path, REAL)
    another = without_ground_truth(make_episode(seed=9, images=True))
    other = write_session(tmp_path / "other.h5", [another])
    merge([path, other], tmp_path / "merged.h5")
    _same(tmp_path / "merged.h5", [*REAL, another])
    trim(path, tmp_path / "trimmed.h5", name="demo_1", start=1, stop=3)
    _same(tmp_path / "trimmed.h5", [REAL[0], _trimmed(REAL[1]), REAL[2]])


def _trimmed(episode):
    whole = prefix_of(episode, 3, stopped_by="interrupted")
    return replace(whole, steps=whole.steps[1:], first_step=1)


def test_it_is_exported_and_imported(path, tmp_path):
    with open_session(path) as session:
        export_robomimic(session, tmp_path / "rm.h5", seed=0)
        export_csv(session, tmp_path / "tables")
        source = TaskEpisodes(session=session, names=session.names, task_text="Lay it flat.")
        assert export_lerobot([source], tmp_path / "lerobot").frames == 15
    assert import_robomimic(tmp_path / "rm.h5", tmp_path / "back.h5").exact
    _same(tmp_path / "back.h5", REAL)
    with (tmp_path / "tables" / EPISODES_CSV).open() as file:
        assert {row["flat_area_final"] for row in csv.DictReader(file)} == {""}
    with (tmp_path / "tables" / STEPS_CSV).open() as file:
        assert {(row["flat_area"], row["contact_portion_true"]) for row in csv.DictReader(file)} == {("", "")}


@pytest.mark.parametrize(("contact", "outcome"), [(0.9, "failure"), (0.99, "success")])
def test_a_foreign_file_is_judged_by_the_camera(path, tmp_path, contact, outcome):
    with h5py.File(path, "r+") as file:
        group = file["data/demo_0"]
        group["next_obs/contact_portion"][-1] = contact
        for key in ("outcome", "attributes_sha256"):
            del group.attrs[key]
    import_robomimic(path, tmp_path / "back.h5", robots=ROBOT_SPECS)
    with open_session(tmp_path / "back.h5") as session:
        assert session.info("demo_0").outcome == outcome
        assert session[0].final_ground_truth is None


def test_ground_truth_of_some_steps_only_is_refused(tmp_path):
    steps = [replace(REAL[0].steps[0], ground_truth=make_episode().steps[0].ground_truth), *REAL[0].steps[1:]]
    with (
        SessionRecorder(tmp_path / "s.h5", robot=HANGER, cloth="towel") as recorder,
        pytest.raises(DataError, match="states is missing at step 1"),
    ):
        recorder.save(replace(REAL[0], steps=steps))


@pytest.mark.parametrize("key", ["states", "ground_truth/flat_area", "ground_truth/final_state"])
def test_a_file_with_a_part_of_the_ground_truth_is_refused(tmp_path, key):
    path = write_session(tmp_path / "s.h5", [make_episode()])
    with h5py.File(path, "r+") as file:
        del file[f"data/demo_0/{key}"]
    with pytest.raises(DataError, match=f"no data set {key}"), open_session(path) as session:
        list(session)
    assert validate(path)[0].path == f"/data/demo_0/{key}"
