from __future__ import annotations

import io
import json
import os
import zipfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from layflat.data.types import Provenance
from layflat.policy import model_io, registry
from layflat.policy.base import PolicyError
from layflat.policy.gp.model import GpModel
from layflat.tests.factories import HANGER, ROBOT_SPECS
from layflat.tests.policy.factories import gp_model, trained_model

ARRAYS = GpModel.ARRAYS


@pytest.fixture
def saved(tmp_path) -> Path:
    model_io.save(gp_model(), tmp_path / "model.npz")
    return tmp_path / "model.npz"


def members(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def rewrite(path: Path, arrays: dict[str, np.ndarray], *removed: str, **header_changes: object) -> None:
    """Change the header and give it a correct checksum, so that only its content can be refused."""
    header = {**json.loads(arrays["header"].tobytes()), **header_changes}
    header = {name: value for name, value in header.items() if name not in removed}
    header["checksum"] = model_io.checksum(header, {name: arrays[name] for name in ARRAYS})
    np.savez(path, **{**arrays, "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)})


def refused(path: Path, message: str) -> None:
    with pytest.raises(PolicyError, match=message) as caught:
        model_io.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "robot"), [*product(registry.TRAINABLE_POLICIES, ROBOT_SPECS)], ids=str)
def test_every_model_comes_back_bit_for_bit(name, robot, tmp_path, differences):
    model = replace(
        trained_model(name, robot),
        provenance=Provenance(versions={"numpy": "2"}, platform="linux", created_utc="2024", command="train"),
        stop_threshold_m=0.0031,
        stop_steps=7,
        action_limit_m=0.015,
        task="smooth",
        descriptor="hog",
        step_s=0.05,
        heldout_rmse_m=None if name == "gp-word" else trained_model(name, robot).heldout_rmse_m,
    )
    path, twin = tmp_path / "model.npz", tmp_path / "twin.npz"
    model_io.save(model, path)
    again = model_io.load(path)
    assert type(again) is type(model)
    assert differences(model, again) == []
    model_io.save(again, twin)
    assert twin.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("name", ["gp-word", "gmr", "dmp", "nearest"])
def test_a_changed_or_missing_array_is_noticed_in_every_format(name, tmp_path):
    model, path = trained_model(name, HANGER), tmp_path / "model.npz"
    model_io.save(model, path)
    whole = members(path)
    for array in model.ARRAYS:
        np.savez(path, **{**whole, array: whole[array] * 1.001 + 1e-3})
        refused(path, "checksum")
        np.savez(path, **{key: value for key, value in whole.items() if key != array})
        refused(path, f"{array}.npy is missing")


def change_header(path: Path, old: bytes, new: bytes) -> None:
    arrays = members(path)
    text = arrays["header"].tobytes()
    assert old in text
    np.savez(path, **{**arrays, "header": np.frombuffer(text.replace(old, new), np.uint8)})


def test_a_changed_header_and_a_model_of_one_method_as_one_of_another_are_noticed(saved, tmp_path):
    change_header(saved, b'"cloth": "towel"', b'"cloth": "linen"')
    refused(saved, "checksum")
    path = tmp_path / "other.npz"
    model_io.save(trained_model("nearest", HANGER), path)
    change_header(path, b"layflat-nearest", b"layflat-dmp")
    refused(path, "must have")


def test_nothing_is_overwritten_unless_forced(saved):
    before = saved.read_bytes()
    with pytest.raises(PolicyError, match="exists already"):
        model_io.save(gp_model(seed=1), saved)
    assert saved.read_bytes() == before
    model_io.save(gp_model(seed=1), saved, force=True)
    assert model_io.load(saved).seed == 1


def test_a_reader_sees_the_whole_old_model_while_it_is_replaced_and_a_failed_write_leaves_it(saved, monkeypatch):
    before = saved.read_bytes()
    with saved.open("rb") as reader:
        half = reader.read(len(before) // 2)
        model_io.save(gp_model(seed=1, points=30), saved, force=True)
        assert half + reader.read() == before
    before = saved.read_bytes()
    monkeypatch.setattr(os, "fsync", Mock(side_effect=OSError(28, "No space left on device")))
    with pytest.raises(PolicyError, match="No space left"):
        model_io.save(gp_model(seed=1), saved, force=True)
    assert saved.read_bytes() == before
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_every_truncation_is_refused(saved):
    whole = saved.read_bytes()
    for size in (0, 1, 30, len(whole) // 3, len(whole) // 2, len(whole) - 30, len(whole) - 1):
        saved.write_bytes(whole[:size])
        refused(saved, r"model\.npz")


def test_no_flipped_byte_changes_a_prediction_unnoticed(saved):
    """Each damaged file is refused, or (bytes that zip does not read) predicts exactly as before."""
    whole = saved.read_bytes()
    queries = np.random.default_rng(2).normal(0, 0.3, (5, 5))
    want, _ = gp_model().predict(queries)
    n_refused = 0
    for at in np.random.default_rng(3).integers(0, len(whole), 120):
        damaged = bytearray(whole)
        damaged[at] ^= 0x41
        saved.write_bytes(damaged)
        try:
            got, _ = model_io.load(saved).predict(queries)
        except PolicyError:
            n_refused += 1
            refused(saved, r"model\.npz")
        else:
            np.testing.assert_array_equal(got, want)
    assert n_refused > 80


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "other"}, "format layflat-gp"),
        ({"schema": 2}, "another version of Layflat; train it again"),
        ({"descriptor": "sift"}, "descriptor is 'sift'"),
        ({"kernel": "os.system"}, "must be one of se"),
        ({"robot": "The Table"}, "robot is named 'The Table'"),
        ({"action_axes": "[[1, 2]]"}, "action axes are"),
        ({"action_axes": None}, "not a usable model"),
        ({"features": ["x", "z", "word_x", "word_y", "secret"]}, "feature 'secret' is unknown"),
        ({"task": ""}, "must name"),
        ({"stop_steps": "8"}, "stop_steps is '8'"),
        ({"stop_threshold_m": float("nan")}, "stop_threshold_m is nan"),
        ({"action_limit_m": 1.0}, "action_limit_m is 1.0"),
        ({"heldout_rmse_m": [1.0]}, "heldout_rmse_m has 1"),
        ({"shapes": {}}, "shapes"),
        ({"provenance": {"run": "me"}}, "not a usable model"),
        ({"features": None}, "not a usable model"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused_even_with_a_correct_checksum(saved, changes, message):
    rewrite(saved, members(saved), **changes)
    refused(saved, message)


def test_a_header_of_an_unreleased_version_is_refused_with_what_to_do(saved):
    rewrite(saved, members(saved), "robot", "action_axes", task="hanger", tick_s=0.1, schema=1)
    refused(saved, "train it again")


def write_zip(path: Path, arrays: dict[str, np.ndarray], compression: int = zipfile.ZIP_STORED, **raw: bytes) -> None:
    """Write the arrays as a model file does, but for members whose bytes are given."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array)
            archive.writestr(f"{name}.npy", raw.get(name, member.getvalue()))


def test_claimed_sizes_are_checked_before_use(saved):
    """A bare numpy would try to allocate a terabyte."""
    arrays, stream = members(saved), io.BytesIO()
    shapes = json.loads(arrays["header"].tobytes())["shapes"]
    for shape in ([10**12, 5], [0, 5], [-1, 5], ["25", 5], [26, 5]):
        rewrite(saved, arrays, shapes={**shapes, "inputs": shape})
        refused(saved, "inputs")
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (20_000, 20_000)})
    rewrite(saved, arrays, shapes={**shapes, "inputs": [20_000, 20_000]})
    arrays = members(saved)
    write_zip(saved, arrays, inputs=stream.getvalue())
    refused(saved, "another number of bytes")
    write_zip(saved, arrays, zipfile.ZIP_DEFLATED, header=bytes(model_io.MAX_HEADER_BYTES + 1))
    refused(saved, "at most")


def test_pickled_content_is_never_run(saved, tmp_path):
    mark = tmp_path / "ran"

    class Bomb:
        def __reduce__(self):
            return (Path.touch, (mark,))

    for name in ("alpha", "header"):
        np.savez(saved, **{**members(saved), name: np.array([Bomb()], dtype=object)})
        refused(saved, name)
        model_io.save(gp_model(), saved, force=True)
    assert not mark.exists()


def test_foreign_and_missing_files_are_refused(tmp_path):
    with pytest.raises(PolicyError, match="cannot write"):
        model_io.save(gp_model(), tmp_path / "nowhere" / "model.npz")
    refused(tmp_path / "model.npz", "does not exist")
    path = tmp_path / "foreign.npz"
    for content in (b"", b"\x89HDF\r\n\x1a\n" + bytes(100), b"not a model", os.urandom(5000)):
        path.write_bytes(content)
        refused(path, "not a model file")
    np.savez(path, a=np.zeros(3))
    refused(path, "not a model file")
    refused(tmp_path, "is not a file")
