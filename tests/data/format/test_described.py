"""A session describes itself to other programs: text as text, camera, mesh, legends; and never trusts that copy."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import h5py
import numpy as np
import pytest

from layflat.data import (
    CameraModel,
    SessionRecorder,
    filter_session,
    merge,
    open_session,
    repair,
    split,
    trim,
    validate,
)
from layflat.data.errors import DataError
from layflat.data.exchange.robomimic import export_robomimic, import_robomimic
from layflat.data.session.journal_reader import read_journal
from layflat.data.tools import validate as validate_module
from layflat.tests.factories import HANGER, differences, initial_of, make_episode, write_session

POSE = np.array([[1.0, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, 0.9], [0, 0, 0, 1]])
CAMERA = CameraModel(width=8, height=6, fx=7.0, fy=7.5, cx=3.5, cy=2.5, cam_to_world=POSE)


def _episode(seed: int = 0, **overrides):
    return make_episode(
        n_steps=3, seed=seed, nodes=12, **{"images": True, "camera": CAMERA, "mesh_shape": (4, 3), **overrides}
    )


@pytest.fixture
def path(tmp_path):
    return write_session(tmp_path / "s.h5", [_episode(seed) for seed in range(3)])


def _read(path):
    with open_session(path) as session:
        return tuple(session)


def test_h5py_reads_text_as_text_and_a_sentence_for_each_data_set(path, tmp_path):
    merge([path], tmp_path / "merged.h5")
    for file in (path, tmp_path / "merged.h5"):
        with h5py.File(file) as f:
            demo = f["data/demo_0"]
            assert demo.attrs["outcome"] == "success"
            assert f["data"].attrs["robot"] == "hanger"
            assert json.loads(demo.attrs["camera"])["cam_to_world"] == POSE.tolist()
            assert (demo.attrs["mesh_rows"], demo.attrs["mesh_columns"]) == (4, 3)
            groups = (demo, demo["obs"], demo["next_obs"], demo["ground_truth"])
            items = [item for group in groups for item in group.values() if isinstance(item, h5py.Dataset)]
            items.append(f["index"])
            assert len(items) > 25
            assert all(len(item.attrs["description"]) > 10 for item in items)
            assert "free edge" in demo["states"].attrs["description"]
            assert all(phase in demo["phase"].attrs["description"] for phase in ("place", "disturb", "repair"))


def test_the_camera_survives_every_operation(path, tmp_path):
    made = _read(path)
    merge([path], tmp_path / "merge.h5")
    filter_session(path, tmp_path / "filter.h5", success=True)
    split(path, {"a": tmp_path / "split.h5", "b": tmp_path / "b.h5"}, {"a": 2, "b": 1}, seed=0)
    trim(path, tmp_path / "trim.h5", name="demo_0", start=1, stop=2)
    repair(path, tmp_path / "repair.h5")
    with open_session(path) as session:
        export_robomimic(session, tmp_path / "export.h5", seed=0)
    import_robomimic(tmp_path / "export.h5", tmp_path / "import.h5")
    with h5py.File(tmp_path / "export.h5", "r+") as f:
        f["data/demo_0"].attrs["source"] = "somebody"
    assert not import_robomimic(tmp_path / "export.h5", tmp_path / "convert.h5").exact
    for name in ("merge", "filter", "split", "trim", "repair", "import", "convert"):
        with open_session(tmp_path / f"{name}.h5") as session:
            assert session.camera == CAMERA, name
            assert {episode.mesh_shape for episode in session} == {(4, 3)}, name
    assert differences(_read(tmp_path / "merge.h5"), made) == []


def test_it_is_known_without_images_and_after_a_killed_recording(tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(_episode(images=False))
        handle = recorder.new_journal()
        journal = handle.open(initial_of(_episode(1, images=False)))
        for step in _episode(1, images=False).steps:
            journal.step(step)
        journal.close()
        assert read_journal(handle.path).episode.camera == CAMERA
    with open_session(path) as session:
        assert [episode.camera for episode in session] == [CAMERA, CAMERA]
        assert [info.images for info in session.infos().values()] == [False, False]


def test_a_session_without_a_camera_says_so(tmp_path):
    with open_session(write_session(tmp_path / "s.h5", [make_episode()])) as session:
        assert session.camera is None
        assert session[0].mesh_shape is None


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"camera": CameraModel(**{**vars(CAMERA), "width": 9})}, "images are 8x6 px, but the camera has 9x6"),
        ({"mesh_shape": (4, 4)}, "4 x 4 nodes, but the states have 12"),
    ],
)
def test_a_camera_or_a_mesh_that_does_not_fit_is_not_saved(tmp_path, overrides, message):
    with (
        SessionRecorder(tmp_path / "s.h5", robot=HANGER, cloth="towel", save_images=True) as recorder,
        pytest.raises(DataError, match=message),
    ):
        recorder.save(_episode(**overrides))


BROKEN = {
    "no json": "{",
    "no object": "[]",
    "no pose": json.dumps({**json.loads(CAMERA.to_json()), "cam_to_world": [[1, 2]]}),
    "a mirror": json.dumps({**json.loads(CAMERA.to_json()), "cam_to_world": np.diag([1.0, 1, -1, 1]).tolist()}),
    "text for a number": json.dumps({**json.loads(CAMERA.to_json()), "fx": "7"}),
    "infinite": CAMERA.to_json().replace("7.0", "Infinity"),
    "a huge image": json.dumps({**json.loads(CAMERA.to_json()), "width": 10**30}),
    "millimetres": CAMERA.to_json().replace('"m"', '"mm"'),
    "of another size": json.dumps({**json.loads(CAMERA.to_json()), "height": 7}),
}


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN.keys())
def test_a_strangers_camera_is_checked(path, tmp_path, text):
    """The attribute is replaced in a file that says no checksum of it, as another tool would write it."""
    foreign = tmp_path / "foreign.hdf5"
    with h5py.File(path) as old, h5py.File(foreign, "w") as new:
        old.copy("data", new)
        del new["data/demo_0"].attrs["texts"]
        new["data/demo_0"].attrs["camera"] = text
    with pytest.raises(DataError, match=r"camera|cam_to_world") as caught:
        import_robomimic(foreign, tmp_path / "back.h5")
    assert str(caught.value).count("\n") == 0


def test_text_that_was_changed_for_other_programs_only_is_reported_and_repaired(path, tmp_path):
    with h5py.File(path, "r+") as f:
        f["data/demo_1"].attrs["outcome"] = "failure"
        f["data"].attrs["cloth"] = "silk"
        f["data/demo_2"].attrs["note"] = "a person's own"
    assert [violation.path for violation in validate(path)] == ["/data/demo_1@outcome", "/data@cloth"]
    assert {episode.outcome for episode in _read(path)} == {"success"}
    repair(path, tmp_path / "again.h5")
    assert validate(tmp_path / "again.h5") == ()
    with h5py.File(tmp_path / "again.h5") as f:
        assert f["data/demo_1"].attrs["outcome"] == "success"
        assert f["data/demo_2"].attrs["note"] == "a person's own"


def test_damage_in_the_global_heap_neither_hangs_nor_matters(path, tmp_path, monkeypatch):
    """These bytes keep HDF5 2.0 in an endless loop when a text attribute is read; HDF5 has no checksum over them."""
    made, content = _read(path), bytearray(path.read_bytes())
    at = content.find(b"GCOL")
    assert at > 0
    while at > 0:
        struct.pack_into("<Q", content, at + 16 + 8, 2**64 - 16)
        at = content.find(b"GCOL", at + 1)
    path.write_bytes(content)
    assert differences(_read(path), made) == []
    merge([path], tmp_path / "merged.h5")
    with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
        recorder.save(replace(made[0], seed=9))
    repair(path, tmp_path / "repaired.h5")
    assert differences(_read(tmp_path / "merged.h5"), made) == []
    assert [episode.seed for episode in _read(tmp_path / "repaired.h5")] == [0, 1, 2, 9]
    monkeypatch.setattr(validate_module, "MIN_LIMIT_S", 2.0)
    assert "took more than 2 s" in validate(path)[0].message
    assert validate(tmp_path / "repaired.h5") == validate(tmp_path / "merged.h5") == ()


def test_points_of_a_depth_image_are_where_the_camera_saw_them():
    depth = np.zeros((6, 8, 1), np.float32)
    depth[2, 3] = 0.9
    points = CAMERA.points(depth)
    assert np.isnan(points).sum() == 3 * 47
    # 0.9 m below the camera, half a pixel off its axis.
    np.testing.assert_allclose(points[2, 3], [0.1 - 0.5 / 7 * 0.9, 0.2 + 0.5 / 7.5 * 0.9, 0.0], atol=1e-6)
