"""The LeRobot export is what LeRobot v3.0's own reader asks for, read here by pyarrow, pandas and `datasets`.

``_lerobot_features`` restates how LeRobot makes column types of info.json; tests/docs/test_examples_lerobot.py trains
with LeRobot itself, where it is installed.
"""

from __future__ import annotations

import io
import json
import os
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from layflat.data import SessionRecorder, open_session
from layflat.data.camera import CameraModel
from layflat.data.errors import DataError
from layflat.data.exchange import lerobot, optional_imports
from layflat.data.exchange.csv_export import export_csv
from layflat.data.exchange.lerobot import LeRobotOptions, TaskEpisodes
from layflat.data.exchange.robomimic import export_robomimic
from layflat.data.types import ACTION_LIMIT_M, OUTCOMES
from layflat.tests.factories import HANGER, ROBOT_SPECS, differences, make_episode, write_session

pq = pytest.importorskip("pyarrow.parquet", reason="needs layflat[export]")
pandas = pytest.importorskip("pandas")
Image = pytest.importorskip("PIL.Image")

RGB, DEPTH = "observation.images.camera", "observation.images.depth"


def export_lerobot(session, folder, names=None, text="Lay it flat.", **options):
    source = TaskEpisodes(session=session, names=session.names if names is None else names, task_text=text)
    return lerobot.export_lerobot([source], folder, LeRobotOptions(**options))


@pytest.fixture(params=ROBOT_SPECS, scope="module")
def exported(request, tmp_path_factory):
    """The folder, and the episodes that went into it."""
    folder = tmp_path_factory.mktemp("exported")
    made = [make_episode(request.param, n_steps=3 + 2 * i, seed=i, images=True) for i in range(4)]
    with open_session(write_session(folder / "s.h5", made)) as session:
        done = export_lerobot(session, folder / "lr", depth=True)
    assert (done.episodes, done.frames, done.images) == (4, 24, True)
    return folder / "lr", made


def _frames(folder: Path):
    return pq.read_table(folder / "data/chunk-000/file-000.parquet")


def _lerobot_features(datasets, info):
    features = {}
    for key, described in info["features"].items():
        value = None if described["dtype"] == "image" else datasets.Value(described["dtype"])
        shape = tuple(described["shape"])
        if value is None:
            features[key] = datasets.Image()
        else:
            features[key] = value if shape == (1,) else datasets.Sequence(value, length=shape[0])
    return datasets.Features(features)


def test_every_number_is_the_episodes_in_float32(exported):
    folder, made = exported
    rows = _frames(folder).to_pylist()
    steps = [(number, step_index) for number, episode in enumerate(made) for step_index in range(len(episode.steps))]
    assert len(rows) == len(steps)
    for index, (row, (number, step_index)) in enumerate(zip(rows, steps, strict=True)):
        episode = made[number]
        step, after = episode.steps[step_index], episode.observations()[step_index + 1]
        seen = step.observation
        state = np.float32([*seen.corner_positions.ravel(), *seen.holder_position])
        cloth = np.float32([*seen.word, seen.word_strength, seen.contact_portion])
        assert row["observation.state"] == state.tolist()
        assert row["observation.environment_state"] == cloth.tolist()
        assert row["action"] == np.float32(step.action / ACTION_LIMIT_M).tolist()
        assert row["next.reward"] == np.float32(after.contact_portion - seen.contact_portion)
        assert row["next.done"] == (step_index == len(episode.steps) - 1)
        assert row["next.success"] == (row["next.done"] and episode.outcome == "success")
        assert (row["index"], row["episode_index"], row["frame_index"], row["task_index"]) == (
            index,
            number,
            step_index,
            0,
        )
        assert row["timestamp"] == np.float32(step_index / 10)


def test_images_keep_every_bit(exported):
    folder, made = exported
    rows = _frames(folder).select([RGB, DEPTH]).to_pylist()
    seen = [step.observation for episode in made for step in episode.steps]
    for row, observation in zip(rows, seen, strict=True):
        rgb, depth = (Image.open(io.BytesIO(row[key]["bytes"])) for key in (RGB, DEPTH))
        assert rgb.format == "PNG"
        np.testing.assert_array_equal(np.asarray(rgb), observation.rgb)
        read = np.asarray(depth)
        assert read.dtype == np.float32
        np.testing.assert_array_equal(read, observation.depth)


def test_the_files_agree_with_each_other(exported):
    folder, made = exported
    info = json.loads((folder / "meta/info.json").read_text())
    frames = _frames(folder)
    rows = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    tasks = pandas.read_parquet(folder / "meta/tasks.parquet")
    assert info["codebase_version"] == "v3.0"
    assert info["fps"] == 10
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (4, 24, 1) == (
        len(rows), frames.num_rows, len(tasks),
    )  # fmt: skip
    assert info["splits"] == {"train": "0:4"}
    assert set(info["features"]) == set(frames.column_names)
    assert tasks.index.name == "task"
    assert tasks.loc[rows[0]["tasks"][0]].task_index == 0
    begin = 0
    for number, (row, episode) in enumerate(zip(rows, made, strict=True)):
        assert (row["episode_index"], row["length"]) == (number, len(episode.steps))
        assert (row["dataset_from_index"], row["dataset_to_index"]) == (begin, begin + row["length"])
        path = info["data_path"].format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
        own = pq.read_table(folder / path, filters=[("episode_index", "=", number)])
        assert own["index"].to_pylist() == list(range(row["dataset_from_index"], row["dataset_to_index"]))
        begin = row["dataset_to_index"]
    for key, described in info["features"].items():
        assert "/" not in key
        if described["dtype"] != "image" and described["shape"] != [1]:
            assert frames.schema.field(key).type.list_size == described["shape"][0] == len(described["names"])
    assert info["features"]["action"]["names"] == list(made[0].robot.action_names)
    assert info["features"][DEPTH]["info"] == {"is_depth_map": True, "depth_unit": "m"}


def test_statistics_are_those_of_the_data(exported):
    folder, made = exported
    stats = json.loads((folder / "meta/stats.json").read_text())
    frames = _frames(folder)
    rows = pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert set(stats) == set(frames.column_names)
    names = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}
    quantiles = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
    for key in ("observation.state", "action", "next.reward"):
        values = np.array(frames[key].to_pylist(), np.float64).reshape(frames.num_rows, -1)
        own = values[: rows[0]["length"]]
        for name, function in names.items():
            np.testing.assert_allclose(stats[key][name], function(values, axis=0), rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(rows[0][f"stats/{key}/{name}"], function(own, axis=0), rtol=1e-9, atol=1e-12)
        for name, share in quantiles.items():
            np.testing.assert_allclose(stats[key][name], np.quantile(values, share, axis=0), rtol=1e-9, atol=1e-12)
        assert stats[key]["count"] == [24]
    seen = [step.observation for episode in made for step in episode.steps]
    rgb, depth = np.array([o.rgb for o in seen]) / 255, np.array([o.depth for o in seen])[..., None]
    for key, values, near in ((RGB, rgb, 1e-9), (DEPTH, depth, 6e-4)):
        for name, function in names.items():
            assert np.shape(stats[key][name]) == (values.shape[3], 1, 1)
            found = np.ravel(stats[key][name])
            np.testing.assert_allclose(found, function(values, axis=(0, 1, 2)), rtol=0, atol=near)
        step = np.ptp(values) / 100  # the sample quantile lies between two neighbouring values
        np.testing.assert_allclose(np.ravel(stats[key]["q50"]), np.median(values, axis=(0, 1, 2)), atol=step)
        assert stats[key]["count"] == [24]


def test_hugging_face_datasets_loads_it(exported, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    datasets = pytest.importorskip("datasets", reason="needs layflat[dev]")
    assert os.environ["HF_HUB_OFFLINE"] == "1"
    folder, made = exported
    info = json.loads((folder / "meta/info.json").read_text())
    features = _lerobot_features(datasets, info)
    files = [str(path) for path in sorted((folder / "data").glob("*/*.parquet"))]
    cache = str(tmp_path / "cache")
    as_lerobot = datasets.Dataset.from_parquet(files, features=features, cache_dir=cache)
    by_metadata = datasets.Dataset.from_parquet(files, cache_dir=cache)
    assert by_metadata.features == features
    last = made[-1].steps[-1]
    for loaded in (as_lerobot, by_metadata):
        assert len(loaded) == 24
        row = loaded[-1]
        assert row["action"] == np.float32(last.action / ACTION_LIMIT_M).tolist()
        np.testing.assert_array_equal(np.asarray(row[RGB]), last.observation.rgb)
        np.testing.assert_array_equal(np.asarray(row[DEPTH]), last.observation.depth)
    episodes = datasets.Dataset.from_parquet(str(folder / "meta/episodes/chunk-000/file-000.parquet"), cache_dir=cache)
    assert episodes["episode_index"][:] == [0, 1, 2, 3]


def test_without_images(tmp_path):
    with open_session(write_session(tmp_path / "s.h5", [make_episode(images=True)])) as session:
        assert not export_lerobot(session, tmp_path / "lr", images=False).images
    assert not any(key.startswith("observation.images") for key in _frames(tmp_path / "lr").column_names)


def test_ground_truth_is_not_exported(exported):
    folder, _ = exported
    features = json.loads((folder / "meta/info.json").read_text())["features"]
    named = [*_frames(folder).column_names, *(name for f in features.values() for name in f["names"] or ())]
    assert not any(word in name for name in named for word in ("true", "node", "area", "states"))


def test_the_table_of_episodes_identifies_them(tmp_path):
    made = [make_episode(seed=10 + i, outcome=OUTCOMES[i], source=["scripted", "gamepad"][i]) for i in range(2)]
    with open_session(write_session(tmp_path / "s.h5", made)) as session:
        export_lerobot(session, tmp_path / "lr", names=("demo_1",))
        info = session.info("demo_1")
    (row,) = pq.read_table(tmp_path / "lr/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for key in ("uid", "seed", "source", "outcome", "success", "stopped_by", "contact_final", "disturbance", "cloth"):
        assert row[key] == getattr(info, key), key
    assert (row["seed"], row["source"]) == (11, "gamepad")


def test_without_depth_every_image_has_three_channels(tmp_path):
    """ACT and Diffusion take each image column for a colour camera."""
    with open_session(write_session(tmp_path / "s.h5", [make_episode(images=True)])) as session:
        assert export_lerobot(session, tmp_path / "lr").images
    features = json.loads((tmp_path / "lr/meta/info.json").read_text())["features"]
    images = {key: described["shape"][2] for key, described in features.items() if described["dtype"] == "image"}
    assert images == {RGB: 3}
    assert "--depth" not in (tmp_path / "lr/README.md").read_text()


def test_unit_limit_and_camera_are_in_info_and_card(tmp_path):
    pose = np.eye(4)
    pose[2, 3] = 0.75
    camera = CameraModel(width=8, height=6, fx=7.0, fy=7.5, cx=3.5, cy=2.5, cam_to_world=pose)
    made = [replace(make_episode(images=True, seed=i), camera=camera) for i in range(2)]
    with open_session(write_session(tmp_path / "s.h5", made)) as session:
        export_lerobot(session, tmp_path / "lr", depth=True, licence="cc-by-4.0")
    features = json.loads((tmp_path / "lr/meta/info.json").read_text())["features"]
    assert features["action"]["info"]["limit_m"] == ACTION_LIMIT_M
    assert features["observation.state"]["info"]["unit"] == "m"
    for key in (RGB, DEPTH):
        assert CameraModel.from_json(json.dumps(features[key]["info"]["camera"])) == camera
    card = (tmp_path / "lr/README.md").read_text()
    yaml = pytest.importorskip("yaml", reason="comes with datasets")
    header = yaml.safe_load(card.split("---")[1])
    assert header["license"] == "cc-by-4.0"
    for text in ("20 mm", "| fx | `7.0` |", "remove_feature", "hanger", "Lay it flat.", "2, 2 of them successes"):
        assert text in card, text


def test_sessions_of_several_tasks_have_a_text_each(tmp_path):
    paths = [
        write_session(tmp_path / f"{cloth}.h5", [make_episode(seed=i, cloth=cloth)])
        for i, cloth in enumerate(("towel", "napkin"))
    ]
    with ExitStack() as stack:
        towels, napkins = (stack.enter_context(open_session(path)) for path in paths)
        sources = [
            TaskEpisodes(session=session, names=session.names, task_text=text)
            for session, text in ((towels, "Lay the towel."), (napkins, "Lay the napkin."), (towels, "Lay it again."))
        ]
        done = lerobot.export_lerobot(sources, tmp_path / "lr")
    assert done.episodes == 2  # the third source repeats the first
    tasks = pandas.read_parquet(tmp_path / "lr/meta/tasks.parquet")
    frames = _frames(tmp_path / "lr")
    rows = pq.read_table(tmp_path / "lr/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for row, text in zip(rows, ("Lay the towel.", "Lay the napkin."), strict=True):
        chosen = frames.slice(row["dataset_from_index"], row["length"])
        assert set(chosen["task_index"].to_pylist()) == {tasks.loc[text].task_index}
        assert row["tasks"] == [text]
    assert json.loads((tmp_path / "lr/meta/info.json").read_text())["total_tasks"] == len(tasks) == 2


def test_sessions_of_two_robots_are_refused(tmp_path):
    paths = [write_session(tmp_path / f"{spec}.h5", [make_episode(spec)]) for spec in ROBOT_SPECS[:2]]
    with ExitStack() as stack:
        sessions = [stack.enter_context(open_session(path)) for path in paths]
        sources = [TaskEpisodes(session=one, names=one.names, task_text="Lay it.") for one in sessions]
        with pytest.raises(DataError, match="robot"):
            lerobot.export_lerobot(sources, tmp_path / "lr")
    assert not (tmp_path / "lr").exists()


def test_the_idle_end_is_left_out(tmp_path):
    episode = make_episode(n_steps=9, outcome="success")
    moving = [replace(step, action=np.full(episode.robot.size, 0.01)) for step in episode.steps[:4]]
    idle = [replace(step, action=np.full(episode.robot.size, -1e-5)) for step in episode.steps[4:]]
    still = replace(episode, steps=idle)
    with open_session(write_session(tmp_path / "s.h5", [replace(episode, steps=(*moving, *idle)), still])) as session:
        assert export_lerobot(session, tmp_path / "whole").frames == 9 + 5
        assert export_lerobot(session, tmp_path / "lr", trim_idle=True).frames == 5 + 1
        split = export_robomimic(session, tmp_path / "rm.h5", seed=0, trim_idle=True)
        assert export_csv(session, tmp_path / "csv", trim_idle=True) == 5 + 1
    assert split
    rows = _frames(tmp_path / "lr").to_pylist()
    assert [row["next.done"] for row in rows] == [False] * 4 + [True] * 2
    assert [row["next.success"] for row in rows] == [False] * 4 + [True] * 2
    with open_session(tmp_path / "rm.h5") as trimmed, open_session(tmp_path / "s.h5") as whole:
        cut = trimmed["demo_0"]
        assert (len(cut.steps), cut.outcome) == (5, "success")
        assert differences(cut.steps, whole["demo_0"].steps[:5], "steps") == []
        assert differences(cut.final_observation, whole["demo_0"].steps[5].observation, "final") == []
    steps = (tmp_path / "csv/steps.csv").read_text().splitlines()
    assert len(steps) == 1 + (5 + 1) + (1 + 1)


def test_large_exports_are_split_into_files(tmp_path, monkeypatch):
    monkeypatch.setattr("layflat.data.exchange.lerobot_tables.DATA_FILE_MB", 0)
    monkeypatch.setattr("layflat.data.exchange.lerobot_tables.CHUNKS_SIZE", 2)
    with open_session(write_session(tmp_path / "s.h5", [make_episode(seed=i) for i in range(5)])) as session:
        export_lerobot(session, tmp_path / "lr")
    files = sorted(str(path.relative_to(tmp_path / "lr/data")) for path in (tmp_path / "lr/data").glob("*/*"))
    assert files == [f"chunk-{i // 2:03d}/file-{i % 2:03d}.parquet" for i in range(5)]
    rows = pq.read_table(tmp_path / "lr/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["data/chunk_index"], row["data/file_index"]) for row in rows] == [divmod(i, 2) for i in range(5)]
    table = pq.read_table(tmp_path / "lr/data")
    assert table["index"].to_pylist() == list(range(25))


def test_a_fractional_frame_rate_is_refused(tmp_path):
    with (
        open_session(write_session(tmp_path / "s.h5", [make_episode(step_s=0.03)])) as session,
        pytest.raises(DataError, match=r"0\.03 s"),
    ):
        export_lerobot(session, tmp_path / "lr")
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


def test_images_are_there_in_all_episodes_or_in_none(tmp_path):
    for images in (True, False):
        with SessionRecorder(tmp_path / "s.h5", robot=HANGER, cloth="towel", save_images=images) as recorder:
            recorder.save(make_episode(images=True, seed=int(images)))
    with open_session(tmp_path / "s.h5") as session:
        with pytest.raises(DataError, match="demo_1 has no images"):
            export_lerobot(session, tmp_path / "lr")
        export_lerobot(session, tmp_path / "lr", images=False)


def test_only_an_earlier_export_is_replaced(tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "letter.txt").write_text("precious")
    with open_session(write_session(tmp_path / "s.h5", [make_episode(seed=i) for i in range(2)])) as session:
        with pytest.raises(DataError, match="not a LeRobot data set"):
            export_lerobot(session, tmp_path / "home")
        export_lerobot(session, tmp_path / "lr")
        export_lerobot(session, tmp_path / "lr", names=("demo_1",))
    assert json.loads((tmp_path / "lr/meta/info.json").read_text())["total_episodes"] == 1
    assert (tmp_path / "home" / "letter.txt").read_text() == "precious"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["home", "lr", "s.h5"]


def test_an_export_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    with open_session(write_session(tmp_path / "s.h5", [make_episode()])) as session:
        export_lerobot(session, tmp_path / "lr")
        before = (tmp_path / "lr/meta/info.json").read_bytes()
        monkeypatch.setattr(
            "layflat.data.exchange.lerobot._write_meta", lambda *a, **k: (_ for _ in ()).throw(OSError("full"))
        )
        with pytest.raises(OSError, match="full"):
            export_lerobot(session, tmp_path / "lr")
    assert (tmp_path / "lr/meta/info.json").read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["lr", "s.h5"]


def test_a_missing_package_is_one_sentence(tmp_path, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(optional_imports.importlib, "import_module", missing)
    with (
        open_session(write_session(tmp_path / "s.h5", [make_episode()])) as session,
        pytest.raises(DataError, match=r"pyarrow.*pip install 'layflat\[ex"),
    ):
        export_lerobot(session, tmp_path / "lr")
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]
