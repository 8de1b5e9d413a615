"""robomimic exports are exact copies, and files that other tools have changed are imported or refused."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.data import SessionRecorder, open_session
from layflat.data.errors import DataError
from layflat.data.exchange.robomimic import export_robomimic, import_robomimic, train_and_valid
from layflat.data.exchange.robomimic_import import UNKNOWN_SEED, UNKNOWN_SOURCE
from layflat.data.types import FLAT_AREA, OUTCOMES
from layflat.tests.data.format.test_round_trip import episodes as any_episode
from layflat.tests.factories import HANGER, ROBOT_SPECS, differences, make_episode, write_session

FEW = settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))


@given(episode=any_episode())
@FEW
def test_export_and_import_conserve_any_episode(episode):
    with tempfile.TemporaryDirectory() as folder:
        path, exported, back = (Path(folder) / name for name in ("s.h5", "rm.hdf5", "back.h5"))
        with SessionRecorder(path, robot=episode.robot, cloth=episode.cloth, save_images=True) as recorder:
            recorder.save(episode)
        with open_session(path) as session:
            uid = session.info("demo_0").uid
            export_robomimic(session, exported, seed=0)
        assert import_robomimic(exported, back).exact
        with open_session(back) as session:
            assert differences(session.episode("demo_0"), episode) == []
            assert session.info("demo_0").uid == uid


def test_the_export_is_the_same_bits_and_two_masks(tmp_path):
    path = write_session(
        tmp_path / "s.h5", [make_episode(seed=i, images=True, outcome=OUTCOMES[i % 2]) for i in range(11)]
    )
    with open_session(path) as session:
        split = export_robomimic(session, tmp_path / "rm.h5", valid_share=0.2, seed=3)
    with h5py.File(path) as ours, h5py.File(tmp_path / "rm.h5") as theirs:
        assert dict(theirs["data"].attrs) == dict(ours["data"].attrs)
        names: list[str] = []
        ours["data"].visit(names.append)
        assert len(names) > 11 * 20
        for name in names:
            a, b = ours["data"][name], theirs["data"][name]
            assert dict(a.attrs) == dict(b.attrs)
            if isinstance(a, h5py.Dataset):
                assert (a.dtype, a.shape, a[()].tobytes()) == (b.dtype, b.shape, b[()].tobytes())
        masks = {key: [name.decode() for name in mask] for key, mask in theirs["mask"].items()}
    assert masks.keys() == {"all", "success", "failure", "train", "valid"}
    assert masks["train"] == list(split["train"])
    assert len(masks["valid"]) == 2
    assert sorted(masks["train"] + masks["valid"]) == sorted(masks["all"])


def _as_robomimic_judges(path, filter_key):
    """What robomimic's scripts/get_dataset_info.py asks of a file; its training asks for disjoint masks as well."""
    with h5py.File(path, "r") as f:
        demos = sorted(element.decode("utf-8") for element in np.array(f[f"mask/{filter_key}"]))
        demos = [demos[i] for i in np.argsort([int(name[5:]) for name in demos])]
        actions = [f[f"data/{demo}/actions"][()] for demo in demos]
        assert min(a.min() for a in actions) >= -1
        assert max(a.max() for a in actions) <= 1
        assert json.loads(f["data"].attrs["env_args"])["env_name"].startswith("layflat/")
        for demo, action in zip(demos, actions, strict=True):
            assert f[f"data/{demo}"].attrs["num_samples"] == len(action)
            for group in ("obs", "next_obs"):
                assert all(len(rows) == len(action) for rows in f[f"data/{demo}/{group}"].values())
        return set(demos)


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_robomimic_reads_the_masks(robot, tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode(robot, n_steps=2 + i, seed=i) for i in range(12)])
    with open_session(path) as session:
        export_robomimic(session, tmp_path / "rm.h5", seed=0)
    train, valid = (_as_robomimic_judges(tmp_path / "rm.h5", key) for key in ("train", "valid"))
    assert train.isdisjoint(valid)
    assert train | valid == {f"demo_{i}" for i in range(12)}
    assert len(valid) == 1


@given(count=st.integers(1, 40), share=st.floats(0, 0.99), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_train_and_valid_take_each_name_once(count, share, seed):
    names = [f"demo_{i}" for i in range(count)]
    split = train_and_valid(names, valid_share=share, seed=seed)
    assert sorted([*split["train"], *split["valid"]]) == sorted(names)
    assert all(list(part) == [name for name in names if name in part] for part in split.values())
    assert split == train_and_valid(names, valid_share=share, seed=seed)
    assert split["train"]
    assert bool(split["valid"]) == (share > 0 and count > 1)
    assert abs(len(split["valid"]) - share * count) <= 1


def test_another_seed_draws_another_split():
    names = [f"demo_{i}" for i in range(30)]
    drawn = {train_and_valid(names, valid_share=0.3, seed=seed)["valid"] for seed in range(5)}
    assert len(drawn) == 5


@pytest.mark.parametrize("share", [-0.1, 1.0, 2.0, float("nan")])
def test_an_impossible_share_is_refused(share):
    with pytest.raises(DataError, match="share for validation"):
        train_and_valid(["demo_0", "demo_1"], valid_share=share, seed=0)


def test_only_the_chosen_are_exported_under_their_own_names(tmp_path):
    made = [make_episode(seed=i, outcome=OUTCOMES[i % 2]) for i in range(6)]
    with open_session(write_session(tmp_path / "s.h5", made)) as session:
        export_robomimic(session, tmp_path / "rm.h5", names=session.select(outcome="failure"), seed=0)
        with pytest.raises(DataError, match="nothing to export"):
            export_robomimic(session, tmp_path / "none.h5", names=(), seed=0)
    assert not (tmp_path / "none.h5").exists()
    with open_session(tmp_path / "rm.h5") as session:
        assert session.names == ("demo_1", "demo_3", "demo_5")
        assert differences(session.episode("demo_3"), made[3]) == []


# Files that another tool wrote in our layout


def _rewritten(source, target, *, skip=(), attributes=(), dtype="<f4", **packing):
    """As by a tool that knows only robomimic's form: of our attributes only ``attributes``, numbers as ``dtype``."""
    with h5py.File(source) as old, h5py.File(target, "w") as new:
        data = new.create_group("data")
        data.attrs["env_args"] = old["data"].attrs["env_args"]
        for name in old["data"]:
            group = data.create_group(name)
            group.attrs["num_samples"] = old[f"data/{name}"].attrs["num_samples"]
            for key in attributes:
                group.attrs[key] = old[f"data/{name}"].attrs[key]
            keys: list[str] = []
            old[f"data/{name}"].visit(keys.append)
            for key in keys:
                item = old[f"data/{name}/{key}"]
                if isinstance(item, h5py.Dataset) and key not in skip:
                    saved = item[()].astype(dtype) if item.dtype.kind == "f" else item[()]
                    group.create_dataset(key, data=saved, **(packing if saved.ndim > 1 else {}))


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_file_without_our_attributes_is_imported(robot, tmp_path):
    made = [make_episode(robot, seed=i, images=True, with_std=True) for i in range(3)]
    foreign, back = tmp_path / "foreign.hdf5", tmp_path / "back.h5"
    _rewritten(write_session(tmp_path / "s.h5", made), foreign, dtype="<f8", compression="gzip", chunks=True)
    done = import_robomimic(foreign, back, robots=ROBOT_SPECS)
    assert (done.episodes, done.exact) == (3, False)
    with open_session(back) as session:
        for original, episode in zip(made, session, strict=True):
            defaults = {"seed": UNKNOWN_SEED, "source": UNKNOWN_SOURCE, "stopped_by": "step_limit", "wall_s": 0.0}
            changed = {"outcome": "failure", "start": {}, "provenance": episode.provenance}
            assert original.final_ground_truth.flat_area <= FLAT_AREA
            assert differences(episode, replace(original, **defaults, **changed)) == []
            assert "foreign.hdf5" in episode.provenance.command


def test_attributes_of_a_foreign_file_are_used_and_float32_only_rounds(tmp_path):
    made = make_episode(seed=7, source="gamepad", stopped_by="interrupted", disturbance="push", step_s=0.05)
    keys = ("seed", "source", "stopped_by", "disturbance", "step_s", "cloth", "outcome", "provenance")
    _rewritten(
        write_session(tmp_path / "s.h5", [made]),
        tmp_path / "f.hdf5",
        attributes=keys,
        skip=("action_m", "action_std", "phase"),
    )
    import_robomimic(tmp_path / "f.hdf5", tmp_path / "back.h5", robots=ROBOT_SPECS)
    with open_session(tmp_path / "back.h5") as session:
        episode = session.episode("demo_0")
    for key in (*keys, "robot"):
        assert getattr(episode, key) == getattr(made, key)
    for got, meant in zip(episode.steps, made.steps, strict=True):
        np.testing.assert_allclose(got.action, meant.action, rtol=1e-6)
        np.testing.assert_allclose(got.ground_truth.nodes, meant.ground_truth.nodes, rtol=1e-6)
        assert (got.phase, got.action_std) == ("place", None)


def test_a_changed_file_is_not_copied_exactly(tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode()])
    with h5py.File(path, "r+") as f:
        f["data/demo_0"].attrs["seed"] = 5  # its checksum no longer fits
        del f["index"]
    assert not import_robomimic(path, tmp_path / "back.h5").exact
    with open_session(tmp_path / "back.h5") as session:
        assert session.info("demo_0").seed == 5


def _delete(key):
    def change(f):
        del f[f"data/demo_0/{key}"]

    return change


def _replace(key, make):
    def change(f):
        old = f[f"data/demo_0/{key}"][()]
        del f[f"data/demo_0/{key}"]
        f[f"data/demo_0/{key}"] = make(old)

    return change


def _later(rows):
    return rows + np.arange(len(rows))[:, None]


def _link(f):
    del f["data/demo_0/states"]
    f["data/demo_0/states"] = h5py.ExternalLink("/etc/passwd", "/")


def _attribute(key, value):
    def change(f):
        f["data/demo_0"].attrs[key] = value

    return change


def _claim(f):
    del f["data/demo_0/obs/word"]
    f["data/demo_0/obs"].create_dataset("word", (10**9, 2), "<f8", chunks=(1000, 2))


BROKEN = {
    "no demos": (lambda f: f["data"].clear(), "no group /data with demos"),
    "another member": (lambda f: f["data"].create_group("notes"), "notes is no demo"),
    "no actions": (_delete("actions"), "no data set actions"),
    "no obs": (_delete("obs"), "no group obs"),
    "no word": (_delete("obs/word"), "no data set obs/word"),
    "no next_obs": (_delete("next_obs/word"), "no data set next_obs/word"),
    "no ground truth": (_delete("ground_truth"), "no group ground_truth"),
    "no states": (_delete("states"), "no data set states"),
    "actions too large": (_replace("actions", lambda a: 3 * a), "within -1..1"),
    "actions of another arm": (_replace("actions", lambda a: np.hstack([a, a[:, :1]])), "3 components"),
    "action_m of other actions": (_replace("action_m", lambda a: a / 2), "delete action_m"),
    "text for numbers": (_replace("obs/word", lambda a: np.full(a.shape, b"x")), "type"),
    "a word of three": (_replace("obs/word", lambda a: np.hstack([a, a])[:, :3]), "3 columns"),
    "not finite": (_replace("states", lambda a: a * np.nan), "not finite"),
    "broken series": (_replace("next_obs/time_s", _later), "one unbroken series"),
    "a phase that is none": (_replace("phase", lambda p: np.full(p.shape, b"nap")), "phase is 'nap'"),
    "a link": (_link, "link to elsewhere"),
    "a claim": (_claim, "claims"),
    "a seed in words": (_attribute("seed", "seven"), "seed"),
    "a seed that is a list": (_attribute("seed", [1, 2]), "seed"),
    "a step without length": (_attribute("step_s", 0.0), "above 0"),
    "an outcome that is none": (_attribute("outcome", "fine"), "outcome"),
    "provenance that is no JSON": (_attribute("provenance", "{"), "JSON"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_foreign_file_is_refused_in_one_sentence(name, tmp_path):
    change, message = BROKEN[name]
    foreign = tmp_path / "foreign.hdf5"
    _rewritten(write_session(tmp_path / "s.h5", [make_episode()]), foreign, dtype="<f8")
    with h5py.File(foreign, "r+") as f:
        change(f)
    with pytest.raises(DataError, match=message) as caught:
        import_robomimic(foreign, tmp_path / "back.h5", robots=ROBOT_SPECS)
    assert str(caught.value).count("\n") == 0
    assert str(foreign) in str(caught.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["foreign.hdf5", "s.h5"]


def test_a_file_that_does_not_name_its_cloth_needs_one(tmp_path):
    foreign = tmp_path / "foreign.hdf5"
    _rewritten(write_session(tmp_path / "s.h5", [make_episode()]), foreign)
    with h5py.File(foreign, "r+") as f:
        f["data"].attrs["env_args"] = "{}"
    with pytest.raises(DataError, match="name the cloth"):
        import_robomimic(foreign, tmp_path / "back.h5", robots=ROBOT_SPECS)
    import_robomimic(foreign, tmp_path / "back.h5", cloth="napkin", robots=ROBOT_SPECS)
    with open_session(tmp_path / "back.h5") as session:
        assert (session.robot, session.cloth) == (HANGER, "napkin")


@pytest.mark.parametrize("content", [None, b"", b"dear diary", b"\x89HDF\r\n\x1a\n" + bytes(100)])
def test_other_bytes_are_not_imported(content, tmp_path):
    path = tmp_path / "x.hdf5"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError, match=r"x\.hdf5"):
        import_robomimic(path, tmp_path / "back.h5")
    assert not (tmp_path / "back.h5").exists()


def test_an_existing_file_is_replaced_only_with_force(tmp_path):
    path = write_session(tmp_path / "s.h5", [make_episode()])
    existing = write_session(tmp_path / "taken.h5", [make_episode(seed=1)])
    before = existing.read_bytes()
    with pytest.raises(DataError, match="exists"):
        import_robomimic(path, existing)
    assert existing.read_bytes() == before
    import_robomimic(path, existing, force=True)
    with open_session(existing) as session:
        assert session.info("demo_0").seed == 0
