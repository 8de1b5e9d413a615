"""An episode is known for the same by its content, wherever it comes from, and copies are never divided."""

from __future__ import annotations

import uuid
from dataclasses import replace

import h5py
import numpy as np
import pytest

from layflat.data import SessionRecorder, merge, open_session, repair, split, trim, validate
from layflat.data.exchange.robomimic import export_robomimic, import_robomimic
from layflat.data.format import schema
from layflat.data.format.content import content_of_episode
from layflat.data.format.masks import read_masks
from layflat.data.types import Provenance
from layflat.tests.factories import HANGER, make_episode, without_ground_truth, write_session

EPISODE = make_episode(n_steps=4, seed=3, images=True)


def _first_step(**changes):
    return replace(EPISODE, steps=(replace(EPISODE.steps[0], **changes), *EPISODE.steps[1:]))


def _nudged(array):
    changed = np.array(array)
    changed.flat[0] += 1e-5
    return changed


RELABELLED = {
    "outcome": replace(EPISODE, outcome="failure"),
    "provenance": replace(EPISODE, provenance=Provenance(operator="someone else", created_utc="2030-01-01T00:00:00Z")),
    "wall time": replace(EPISODE, wall_s=99.0),
    "seed": replace(EPISODE, seed=-1, source="imported"),
}
CHANGED = {
    "action": _first_step(action=_nudged(EPISODE.steps[0].action)),
    "word": _first_step(observation=replace(EPISODE.steps[0].observation, word=[0.6, 0.8])),
    "position": _first_step(
        observation=replace(EPISODE.steps[0].observation, holder_position=_nudged([0.1, 0.2, 0.3]))
    ),
    "cloth": replace(EPISODE, final_ground_truth=replace(EPISODE.final_ground_truth, nodes=_nudged(np.zeros((12, 3))))),
    "length": replace(EPISODE, steps=EPISODE.steps[:3]),
    "no ground truth": without_ground_truth(EPISODE),
}


@pytest.mark.parametrize("what", RELABELLED)
def test_labels_do_not_change_the_content(what):
    assert content_of_episode(RELABELLED[what]) == content_of_episode(EPISODE)


@pytest.mark.parametrize("what", CHANGED)
def test_what_was_seen_and_done_is_the_content(what):
    assert content_of_episode(CHANGED[what]) != content_of_episode(EPISODE)


def test_the_content_is_that_of_the_episode_with_an_index_or_without_and_without_images(tmp_path):
    episodes = [EPISODE, *CHANGED.values()][:-1]
    path = write_session(tmp_path / "s.h5", episodes)
    bare = write_session(tmp_path / "bare.h5", episodes, save_images=False)
    with h5py.File(bare, "r+") as file:
        del file[schema.INDEX]
    for file in (path, bare):
        with open_session(file) as session:
            assert [*session.contents().values()] == [content_of_episode(episode) for episode in episodes]
            assert session.copies() == {}
    assert validate(path) == ()


def test_the_recorder_says_what_is_there_already_and_keeps_it(tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode(seed=0), EPISODE])
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        copies = [recorder.save(episode).copy_of for episode in (EPISODE, make_episode(seed=5), make_episode(seed=5))]
    assert copies == ["demo_1", None, "demo_3"]
    with open_session(path) as session:
        assert session.copies() == {"demo_2": "demo_1", "demo_4": "demo_3"}
        assert session.copies(["demo_4", "demo_3"]) == {"demo_3": "demo_4"}
    assert validate(path) == ()


def test_merge_takes_the_same_content_once_as_the_first_is_labelled(tmp_path):
    first = write_session(tmp_path / "a.h5", [make_episode(seed=seed) for seed in range(3)])
    other = [replace(make_episode(seed=1), outcome="failure", wall_s=9.0), make_episode(seed=7)]
    second, left_out = write_session(tmp_path / "b.h5", other), []
    names = merge([first, second], tmp_path / "all.h5", on_copy=left_out.append)
    assert names == ("demo_0", "demo_1", "demo_2", "demo_3")
    (copy,) = left_out
    assert (copy.path, copy.name, copy.outcome, copy.kept, copy.kept_outcome) == (
        second, "demo_0", "failure", "demo_1", "success",
    )  # fmt: skip
    with open_session(tmp_path / "all.h5") as session:
        assert [info.seed for info in session.infos().values()] == [0, 1, 2, 7]
        assert session.info("demo_1").outcome == "success"


def test_what_another_tool_has_stored_as_float32_is_the_same(tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode(seed=seed) for seed in range(2)])
    with open_session(path) as session:
        export_robomimic(session, tmp_path / "rm.h5", seed=0)
    with h5py.File(tmp_path / "rm.h5", "r+") as file:
        for demo in file["data"].values():
            for key in (*demo["obs"], *demo["next_obs"]):
                for group in (demo["obs"], demo["next_obs"]):
                    if key in group and group[key].dtype == np.float64:
                        rows = group[key][()].astype(np.float32)
                        del group[key]
                        group[key] = rows
            actions = demo["actions"][()].astype(np.float32)
            del demo["actions"], demo["action_m"]
            demo["actions"] = actions
    for name in ("back.h5", "again.h5"):
        assert not import_robomimic(tmp_path / "rm.h5", tmp_path / name, robots=[HANGER]).exact
    assert len(merge([path, tmp_path / "back.h5", tmp_path / "again.h5"], tmp_path / "all.h5")) == 2


@pytest.fixture
def copied(tmp_path):
    """Six recordings: two of them there twice, one also trimmed."""
    made = [make_episode(seed=seed, n_steps=6) for seed in range(6)]
    path = write_session(tmp_path / "s.h5", made)
    trim(path, tmp_path / "t.h5", name="demo_2", start=1, stop=5)
    again = write_session(tmp_path / "again.h5", made[:2])
    for file in (again, tmp_path / "t.h5"):
        with open_session(file) as session, SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
            for name in session.names if file == again else ["demo_2"]:
                recorder.save(session.episode(name))
    return path


SAME = ({"demo_0", "demo_6"}, {"demo_1", "demo_7"}, {"demo_2", "demo_8"})


def test_copies_and_trimmed_copies_belong_to_their_recording(copied):
    with open_session(copied) as session:
        assert session.copies() == {"demo_6": "demo_0", "demo_7": "demo_1"}
        own = {f"demo_{k}": f"demo_{k}" for k in range(6)}
        assert session.recordings() == own | {"demo_6": "demo_0", "demo_7": "demo_1", "demo_8": "demo_2"}
        assert session.recordings(["demo_8", "demo_3"]) == {"demo_8": "demo_8", "demo_3": "demo_3"}


@pytest.mark.parametrize("seed", range(6))
def test_copies_are_never_divided_between_learning_and_held_out(copied, tmp_path, seed):
    targets = {"train": tmp_path / "train.h5", "valid": tmp_path / "valid.h5"}
    parts = split(copied, targets, {"train": 0.5, "valid": 0.5}, seed)
    with open_session(copied) as session:
        exported = export_robomimic(session, tmp_path / "rm.h5", valid_share=0.5, seed=seed)
    with h5py.File(tmp_path / "rm.h5") as file:
        masks = read_masks(file, file_bytes=file.id.get_filesize())
    for drawn in (parts, exported, {key: masks[key] for key in ("train", "valid")}):
        assert sorted([*drawn["train"], *drawn["valid"]]) == [f"demo_{k}" for k in range(9)]
        for together in SAME:
            assert together <= set(drawn["train"]) or together <= set(drawn["valid"])


def test_a_stale_digest_in_the_index_is_found_and_repaired(tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode(seed=seed) for seed in range(2)])
    with h5py.File(path, "r+") as file:
        for key in ("actions", "action_m"):
            file[f"data/demo_1/{key}"][...] = file[f"data/demo_0/{key}"][...]
    (violation,) = validate(path)
    assert violation.path == "/index"
    assert "demo_1" in violation.message
    repair(path)
    assert validate(path) == ()
    with open_session(path) as session:
        assert session.contents()["demo_1"] == content_of_episode(session[1])


def test_a_copied_group_in_a_foreign_file_is_found_without_an_index(tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode(seed=seed, n_steps=4) for seed in range(2)])
    with h5py.File(path, "r+") as file:
        file.copy("data/demo_0", file["data"], name="demo_9")
        file["data"].attrs[schema.TOTAL] = 12
    with open_session(path) as session:
        assert session.copies() == {"demo_9": "demo_0"}
    assert uuid.UUID(session.info("demo_0").uid)
