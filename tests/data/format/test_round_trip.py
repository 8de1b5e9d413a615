"""Saved episodes are read back bit by bit, and robomimic can read the file."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from layflat.data import SessionRecorder, open_session
from layflat.data.errors import DataError
from layflat.data.types import (
    ACTION_LIMIT_M,
    DESCRIPTORS,
    OUTCOMES,
    PHASES,
    STOP_REASONS,
    DisturbanceRecord,
    DragTarget,
    Episode,
    GroundTruth,
    Observation,
    Provenance,
    Step,
)
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS, differences, make_episode

finite = st.floats(allow_nan=False, allow_infinity=False)
text = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)
any_text = st.text(st.characters(codec="utf-8") | st.sampled_from("\udc80\udcff"), max_size=12)
"""Command lines may hold what Python made of bytes that are no UTF-8."""


@st.composite
def observations(draw, rgb_shape, depth_shape):
    return Observation(
        time_s=draw(finite),
        corner_positions=draw(arrays(np.float64, (2, 3), elements=finite)),
        holder_position=draw(arrays(np.float64, 3, elements=finite)),
        word=draw(arrays(np.float64, 2, elements=finite)),
        word_strength=draw(finite),
        contact_portion=draw(st.floats(-1e300, 1e300)),
        rgb=None if rgb_shape is None else draw(arrays(np.uint8, (*rgb_shape, 3))),
        depth=None
        if depth_shape is None
        else draw(arrays(np.float32, depth_shape, elements=st.floats(allow_nan=False, allow_infinity=False, width=32))),
    )


@st.composite
def disturbances(draw, n_steps):
    first = draw(st.integers(0, n_steps - 1))
    return DisturbanceRecord(
        name=draw(any_text),
        first_step=first,
        last_step=draw(st.none() | st.integers(first, n_steps - 1)),
        plan=draw(st.dictionaries(any_text, st.lists(finite | st.integers(), max_size=2), max_size=2)),
    )


@st.composite
def episodes(draw):
    robot = draw(st.sampled_from(ROBOT_SPECS))
    nodes, three = draw(st.integers(0, 4)), arrays(np.float64, 3, elements=finite)
    shape = st.none() | st.tuples(st.integers(0, 3), st.integers(0, 3))
    observation = observations(draw(shape), draw(shape))
    ground_truth = st.none()
    if draw(st.booleans()):
        position = arrays(np.float64, (nodes, 3), elements=finite)
        ground_truth = st.builds(GroundTruth, nodes=position, contact_portion_true=finite, flat_area=finite)
    size = len(robot.action_names)
    step = st.builds(
        Step,
        observation=observation,
        ground_truth=ground_truth,
        action=arrays(np.float64, size, elements=st.floats(-ACTION_LIMIT_M, ACTION_LIMIT_M)),
        action_std=st.none() | arrays(np.float64, size, elements=finite),
        phase=st.sampled_from(PHASES),
        drag=st.none() | st.builds(DragTarget, node=st.integers(0, 2**40), target_m=three),
        force_n=st.just(np.zeros(3)) | three,
        intervention=st.booleans(),
        hand_m=st.none() | arrays(np.float64, robot.hand_shape, elements=finite),
    )
    n_steps = draw(st.integers(1, 3))
    return Episode(
        robot=robot,
        cloth=draw(text),
        seed=draw(st.integers(-(2**63) + 1, 2**63 - 1)),
        source=draw(text),
        steps=tuple(draw(step) for _ in range(n_steps)),
        final_observation=draw(observation),
        final_ground_truth=draw(ground_truth),
        stopped_by=draw(st.sampled_from(STOP_REASONS)),
        outcome=draw(st.sampled_from(OUTCOMES)),
        step_s=draw(st.floats(1e-9, 1e9)),
        disturbance=draw(text),
        wall_s=draw(finite),
        start=draw(st.dictionaries(any_text, finite, max_size=3)),
        provenance=draw(
            st.builds(
                Provenance,
                versions=st.dictionaries(any_text, any_text, max_size=3),
                platform=any_text,
                created_utc=any_text,
                command=any_text,
                operator=any_text,
            )
        ),
        descriptor=draw(st.sampled_from(DESCRIPTORS)),
        sim_config=draw(st.dictionaries(any_text, text | finite | st.booleans(), max_size=3)),
        initial_joints=draw(arrays(np.float64, st.integers(0, 3), elements=finite)),
        disturbances=draw(st.lists(disturbances(n_steps), max_size=3)),
        first_step=draw(st.integers(0, 2**40)),
    )


@given(episode=episodes())
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
def test_any_valid_episode_survives_the_file(episode):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.h5"
        with SessionRecorder(
            path, robot=episode.robot, cloth=episode.cloth, save_images=True, descriptor=episode.descriptor
        ) as recorder:
            saved = recorder.save(episode)
        with open_session(path) as session:
            assert differences(session.episode(saved.name), episode) == []
            assert (session.robot, session.cloth, session.step_s) == (episode.robot, episode.cloth, episode.step_s)


def test_images_are_left_out_where_not_asked_for(tmp_path):
    episode = make_episode(images=True)
    for save_images in (False, True):
        path = tmp_path / f"{save_images}.h5"
        with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=save_images) as recorder:
            recorder.save(episode)
        with open_session(path) as session:
            assert session.info("demo_0").images is save_images
            assert (session.episode("demo_0").final_observation.rgb is not None) is save_images
            assert all(o.rgb is None for o in session.episode("demo_0", images=False).observations())


def test_episodes_are_ordered_by_number_and_appended(tmp_path):
    path = tmp_path / "s.h5"
    made = [make_episode(seed=i, outcome=OUTCOMES[i % 3], source=["scripted", "gamepad"][i % 2]) for i in range(12)]
    for batch in (made[:5], made[5:]):
        with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
            names = [recorder.save(episode).name for episode in batch]
    assert names[-1] == "demo_11"
    with open_session(path) as session:
        assert session.names == tuple(f"demo_{i}" for i in range(12))
        assert len(session) == 12
        assert all(differences(a, b) == [] for a, b in zip(session, made, strict=True))
        assert session.select(outcome="success", source="gamepad") == ("demo_3", "demo_9")
        with pytest.raises(DataError, match="has no episode 'demo_12'"):
            session.episode("demo_12")
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]


def _as_robomimic_reads(path):
    """The reading steps of robomimic's scripts/get_dataset_info.py and its SequenceDataset, in their order."""
    with h5py.File(path, "r") as f:
        demos = sorted(f["data"].keys())
        filters = {key: sorted(e.decode("utf-8") for e in np.array(f[f"mask/{key}"])) for key in f["mask"]}
        demos = [demos[i] for i in np.argsort([int(e[5:]) for e in demos])]
        lengths = [f[f"data/{d}/actions"].shape[0] for d in demos]
        actions = [f[f"data/{d}/actions"][()] for d in demos]
        meta = json.loads(f["data"].attrs["env_args"])
        arrays_ = {}
        for d in demos:
            assert f[f"data/{d}"].attrs["num_samples"] == f[f"data/{d}/actions"].shape[0]
            arrays_[d] = {k: f[f"data/{d}/{k}"][()] for k in ("rewards", "dones", "states")}
            arrays_[d] |= {f"{g}/{k}": v[()] for g in ("obs", "next_obs") for k, v in f[f"data/{d}/{g}"].items()}
        return demos, filters, lengths, actions, meta, arrays_, int(f["data"].attrs["total"])


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_the_file_is_what_robomimic_reads(tmp_path, robot):
    path = tmp_path / "s.h5"
    made = [make_episode(robot, n_steps=3 + i, seed=i, images=True, outcome=OUTCOMES[i % 2]) for i in range(11)]
    with SessionRecorder(path, robot=robot, cloth="towel", save_images=True) as recorder:
        for episode in made:
            recorder.save(episode)
    demos, filters, lengths, actions, meta, found, total = _as_robomimic_reads(path)
    assert lengths == [len(e.steps) for e in made]
    assert total == sum(lengths)
    assert meta["type"] == 2
    assert {"env_name", "env_version", "env_kwargs"} <= meta.keys()
    assert filters["all"] == sorted(demos)
    assert sorted(filters["success"] + filters["failure"]) == sorted(demos)
    for name, episode, action in zip(demos, made, actions, strict=True):
        n, arrays_ = len(episode.steps), found[name]
        assert action.shape == (n, len(robot.action_names))
        assert np.abs(action).max() <= 1
        np.testing.assert_allclose(action * ACTION_LIMIT_M, [s.action for s in episode.steps], rtol=1e-12)
        assert all(len(rows) == n for rows in arrays_.values())
        assert arrays_["rewards"].ndim == arrays_["dones"].ndim == 1
        assert arrays_["dones"].tolist() == [0] * (n - 1) + [1]
        assert arrays_["rewards"].sum() == pytest.approx(episode.contact()[-1] - episode.contact()[0])
        assert arrays_["obs/contact_portion"].shape == (n, 1)
        assert arrays_["obs/rgb"].dtype == np.uint8
        assert arrays_["obs/rgb"].shape[-1] == 3
        for key in [k.removeprefix("obs/") for k in arrays_ if k.startswith("obs/")]:
            np.testing.assert_array_equal(arrays_[f"next_obs/{key}"][:-1], arrays_[f"obs/{key}"][1:])
        # What only the simulator knows is under no key that a policy is trained on.
        assert not any("true" in key or "node" in key or "area" in key for key in arrays_)


def test_additions_of_users_stay_when_a_file_grows(tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode())
    with h5py.File(path, "r+") as f:
        f["mask/train"] = np.array([b"demo_0"])
        f["data"].attrs["author"] = "a person"
        f["notes/text"] = "first take"
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode(seed=1))
    with h5py.File(path, "r") as f:
        assert f["mask/train"][()].tolist() == [b"demo_0"]
        assert f["mask/all"][()].tolist() == [b"demo_0", b"demo_1"]
        assert f["data"].attrs["author"] == "a person"
        assert f["notes/text"][()] == b"first take"


def _changed(episode, **step_changes):
    values = {key: getattr(episode.steps[1], key) for key in ("observation", "ground_truth", "action", "phase")}
    steps = [*episode.steps[:1], Step(**(values | step_changes)), *episode.steps[2:]]
    return {"steps": steps}


def test_an_episode_that_a_file_cannot_hold_is_refused(tmp_path):
    path = tmp_path / "s.h5"
    good = make_episode(images=True)
    too_far = np.nextafter(ACTION_LIMIT_M, 1)
    fewer_nodes = GroundTruth(nodes=np.zeros((3, 3)), contact_portion_true=0, flat_area=0)
    no_images = make_episode().steps[1].observation
    refused = [
        (make_episode(images=True, **_changed(good, action=[0.0, too_far])), r"step 1.*0\.02"),
        (make_episode(images=True, **_changed(good, ground_truth=fewer_nodes)), "states changes its shape"),
        (make_episode(images=True, **_changed(good, observation=no_images)), "rgb is missing at step 1"),
        (make_episode(steps=()), "no steps"),
        (make_episode(seed=2**64), "seed"),
        (make_episode(source="a\0b"), "source"),
        (make_episode(wall_s=float("nan")), "wall_s"),
        (make_episode(start={"mass": float("inf")}), "start"),
        (make_episode(step_s=0.05), "step_s is 0.05"),
        (make_episode(cloth="napkin"), "cloth is napkin"),
        (make_episode(descriptor="how"), "descriptor is how"),
        (make_episode(sim_config={"camera": object()}), "sim_config is"),
        (make_episode(PICKERS), "robot is pickers"),
    ]
    with SessionRecorder(path, robot=HANGER, cloth="towel", save_images=True) as recorder:
        recorder.save(good)
        for episode, message in refused:
            with pytest.raises(DataError, match=message):
                recorder.save(episode)
        assert recorder.save(good).name == "demo_1"
    with pytest.raises(DataError, match="closed"):
        recorder.save(good)
    with open_session(path) as session:
        assert [differences(episode, good) for episode in session] == [[], []]


def test_no_data_set_holds_python_objects(tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode())
    objects = []
    with h5py.File(path, "r") as f:
        f.visititems(lambda name, item: objects.append(item.dtype.kind) if isinstance(item, h5py.Dataset) else None)
    assert set(objects) <= set("fuS")
