from __future__ import annotations

import io
import json
import os
import zipfile
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from layflat.data.types import Provenance
from layflat.policy import model_io as model_file
from layflat.policy import registry
from layflat.policy.base import PolicyError
from layflat.policy.gp.model import GpModel
from layflat.tests.factories import HANGER, ROBOT_SPECS

ARRAYS = GpModel.ARRAYS


@pytest.fixture
def saved(tmp_path, model_of) -> Path:
    path = tmp_path / "model.npz"
    model_file.save(model_of(), path)
    return path


def members(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def rewrite(path: Path, arrays: dict[str, np.ndarray], **header_changes: object) -> None:
    """A file with a changed header whose checksum is right: only the content can be refused."""
    header = {**json.loads(arrays["header"].tobytes()), **header_changes}
    if all(name in arrays for name in ARRAYS):
        header["checksum"] = model_file.checksum(header, {name: arrays[name] for name in ARRAYS})
    np.savez(path, **{**arrays, "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)})


@pytest.mark.parametrize("robot", ROBOT_SPECS)
@pytest.mark.parametrize("inputs", ["position", "position+word", "all"])
def test_round_trip_predicts_bit_for_bit(robot, inputs, tmp_path, model_of):
    model = replace(
        model_of(robot, inputs),
        heldout_rmse_m=None if inputs == "all" else model_of(robot, inputs).heldout_rmse_m,
        provenance=Provenance(versions={"numpy": "2"}, platform="linux", created_utc="2024", command="train"),
        stop_threshold_m=0.0031,
        descriptor="hog",
        step_s=0.05,
    )
    path = tmp_path / "model.npz"
    model_file.save(model, path)
    again = model_file.load(path)
    queries = np.random.default_rng(1).normal(0, 0.3, (50, model.layout.size))
    for ours, theirs in zip(model.predict(queries), again.predict(queries), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    told = ("policy", "layout", "cloth", "descriptor", "step_s", "action_limit_m", "stop_threshold_m", "stop_steps")
    for name in (*told, "seed", "demonstrations", "points_available", "heldout_rmse_m", "provenance"):
        assert getattr(again, name) == getattr(model, name)


@pytest.mark.parametrize("robot", ROBOT_SPECS)
@pytest.mark.parametrize("name", registry.TRAINABLE_POLICIES)
def test_every_method_comes_back_as_it_was(name, robot, tmp_path, learned_of, observe):
    model = replace(learned_of(name, robot), provenance=Provenance(versions={"numpy": "2"}, command="train"))
    path, twin = tmp_path / "model.npz", tmp_path / "twin.npz"
    model_file.save(model, path)
    again = model_file.load(path)
    assert type(again) is type(model)
    for field in fields(model):
        ours, theirs = getattr(model, field.name), getattr(again, field.name)
        if isinstance(ours, np.ndarray):
            np.testing.assert_array_equal(ours, theirs)
        elif field.name != "hyper":
            assert ours == theirs
    first, second = registry.from_model(model), registry.from_model(again)
    for policy in (first, second):
        policy.reset(0)
    for k in range(20):
        seen = observe(0.02 * k, 0.4 - 0.02 * k, contact=0.05 * k)
        np.testing.assert_array_equal(first.act(seen).action, second.act(seen).action)
    model_file.save(again, twin)
    assert twin.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("name", ["gmr", "dmp", "nearest"])
def test_what_is_damaged_or_missing_is_noticed_in_every_format(name, tmp_path, learned_of):
    model, path = learned_of(name, HANGER), tmp_path / "model.npz"
    model_file.save(model, path)
    whole = members(path)
    for array in model.ARRAYS:
        np.savez(path, **{**whole, array: whole[array] + 1e-3})
        with pytest.raises(PolicyError, match="checksum"):
            model_file.load(path)
        np.savez(path, **{key: value for key, value in whole.items() if key != array})
        with pytest.raises(PolicyError, match=f"{array}.npy is missing"):
            model_file.load(path)


def test_a_model_of_one_method_is_none_of_another(tmp_path, learned_of):
    path = tmp_path / "model.npz"
    model_file.save(learned_of("nearest", HANGER), path)
    arrays = members(path)
    text = arrays["header"].tobytes().replace(b"layflat-nearest", b"layflat-dmp")
    np.savez(path, **{**arrays, "header": np.frombuffer(text, np.uint8)})
    with pytest.raises(PolicyError, match="must have"):
        model_file.load(path)


def test_same_model_same_bytes(saved, tmp_path, model_of):
    twin = tmp_path / "twin.npz"
    model_file.save(model_of(), twin)
    assert twin.read_bytes() == saved.read_bytes()


def test_nothing_is_overwritten_unless_forced(saved, model_of):
    before = saved.read_bytes()
    with pytest.raises(PolicyError, match="exists already"):
        model_file.save(model_of(seed=1), saved)
    assert saved.read_bytes() == before
    model_file.save(model_of(seed=1), saved, force=True)
    assert model_file.load(saved).seed == 1


def test_who_reads_while_a_model_is_replaced_sees_the_whole_old_one(saved, model_of):
    before = saved.read_bytes()
    with saved.open("rb") as reader:
        half = reader.read(len(before) // 2)
        model_file.save(model_of(seed=1, points=30), saved, force=True)
        assert half + reader.read() == before


def test_a_failed_write_leaves_the_old_file_and_no_litter(saved, model_of, monkeypatch):
    before = saved.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(PolicyError, match="No space left"):
        model_file.save(model_of(seed=1), saved, force=True)
    assert saved.read_bytes() == before
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_missing_folder_is_one_sentence(tmp_path, model_of):
    with pytest.raises(PolicyError, match="cannot write"):
        model_file.save(model_of(), tmp_path / "nowhere" / "model.npz")


def test_missing_file_is_one_sentence(tmp_path):
    with pytest.raises(PolicyError, match="does not exist"):
        model_file.load(tmp_path / "model.npz")


def test_every_truncation_is_refused(saved):
    whole = saved.read_bytes()
    for size in (0, 1, 30, len(whole) // 3, len(whole) // 2, len(whole) - 30, len(whole) - 1):
        saved.write_bytes(whole[:size])
        with pytest.raises(PolicyError, match=r"model\.npz"):
            model_file.load(saved)


def test_no_flipped_byte_changes_a_prediction_unnoticed(saved, model_of):
    """Each damaged file is refused, or (bytes that zip does not read) predicts exactly as before."""
    whole = saved.read_bytes()
    queries = np.random.default_rng(2).normal(0, 0.3, (5, 5))
    want, _ = model_of().predict(queries)
    refused: list[str] = []
    for at in np.random.default_rng(3).integers(0, len(whole), 120):
        damaged = bytearray(whole)
        damaged[at] ^= 0x41
        saved.write_bytes(damaged)
        try:
            got, _ = model_file.load(saved).predict(queries)
        except PolicyError as error:
            refused.append(str(error))
        else:
            np.testing.assert_array_equal(got, want)
    assert len(refused) > 80
    assert not any("\n" in message for message in refused)


@pytest.mark.parametrize("name", ARRAYS)
def test_a_changed_array_is_noticed(saved, name):
    arrays = members(saved)
    arrays[name] = arrays[name] * 1.001
    np.savez(saved, **arrays)
    with pytest.raises(PolicyError, match="checksum"):
        model_file.load(saved)


def test_a_changed_header_is_noticed(saved):
    arrays = members(saved)
    text = arrays["header"].tobytes().replace(b'"cloth": "towel"', b'"cloth": "linen"')
    arrays["header"] = np.frombuffer(text, dtype=np.uint8)
    np.savez(saved, **arrays)
    with pytest.raises(PolicyError, match="checksum"):
        model_file.load(saved)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "other"}, "format layflat-gp"),
        ({"schema": 2}, "another version of Layflat; train it again"),
        ({"action_axes": None}, "not a usable model"),
        ({"descriptor": "sift"}, "descriptor is 'sift'"),
        ({"kernel": "os.system"}, "must be one of se"),
        ({"robot": "The Table"}, "robot is named 'The Table'"),
        ({"action_axes": "[[1, 2]]"}, "action axes are"),
        ({"features": ["x", "z", "word_x", "word_y", "secret"]}, "feature 'secret' is unknown"),
        ({"task": ""}, "must name"),
        ({"stop_steps": "8"}, "stop_steps is '8'"),
        ({"stop_threshold_m": float("nan")}, "stop_threshold_m is nan"),
        ({"action_limit_m": 1.0}, "action_limit_m is 1.0"),
        ({"shapes": {}}, "shapes"),
        ({"provenance": {"run": "me"}}, "not a usable model"),
        ({"features": None}, "not a usable model"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused_even_with_a_right_checksum(saved, changes, message):
    rewrite(saved, members(saved), **changes)
    with pytest.raises(PolicyError, match=message):
        model_file.load(saved)


def test_claimed_sizes_are_checked_before_use(saved):
    arrays = members(saved)
    shapes = json.loads(arrays["header"].tobytes())["shapes"]
    for shape in ([10**12, 5], [0, 5], [-1, 5], ["25", 5], [26, 5]):
        rewrite(saved, arrays, shapes={**shapes, "inputs": shape})
        with pytest.raises(PolicyError, match="inputs"):
            model_file.load(saved)


def test_an_array_that_claims_more_than_it_has_is_refused(saved):
    """A bare numpy would try to set a terabyte aside."""
    arrays = members(saved)
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (20_000, 20_000)})
    with zipfile.ZipFile(saved, "w") as archive:
        header = json.loads(arrays["header"].tobytes())
        header["shapes"]["inputs"] = [20_000, 20_000]
        for name, array in {**arrays, "header": np.frombuffer(json.dumps(header).encode(), np.uint8)}.items():
            member = io.BytesIO()
            np.save(member, array)
            archive.writestr(f"{name}.npy", stream.getvalue() if name == "inputs" else member.getvalue())
    with pytest.raises(PolicyError, match="another number of bytes"):
        model_file.load(saved)


def test_pickled_content_is_never_run(saved, tmp_path):
    mark = tmp_path / "ran"

    class Bomb:
        def __reduce__(self):
            return (Path.touch, (mark,))

    arrays = members(saved)
    np.savez(saved, **{**arrays, "alpha": np.array([Bomb()], dtype=object)})
    with pytest.raises(PolicyError, match="alpha"):
        model_file.load(saved)
    np.savez(saved, **{**arrays, "header": np.array([Bomb()], dtype=object)})
    with pytest.raises(PolicyError, match="header"):
        model_file.load(saved)
    assert not mark.exists()


def test_foreign_files_are_refused(tmp_path):
    path = tmp_path / "foreign.npz"
    for content in (b"", b"\x89HDF\r\n\x1a\n" + bytes(100), b"not a model", os.urandom(5000)):
        path.write_bytes(content)
        with pytest.raises(PolicyError, match="not a model file"):
            model_file.load(path)
    np.savez(path, a=np.zeros(3))
    with pytest.raises(PolicyError, match="not a model file"):
        model_file.load(path)
    with pytest.raises(PolicyError, match="cannot read"):
        model_file.load(tmp_path)


def test_a_zip_that_unpacks_to_too_much_is_refused(saved):
    arrays = members(saved)
    with zipfile.ZipFile(saved, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("header", *ARRAYS):
            member = io.BytesIO()
            np.save(member, arrays[name])
            content = bytes(model_file.MAX_HEADER_BYTES + 1) if name == "header" else member.getvalue()
            archive.writestr(f"{name}.npy", content)
    with pytest.raises(PolicyError, match="at most"):
        model_file.load(saved)
