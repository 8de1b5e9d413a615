"""Columns of a LeRobot data set, and their values for an episode."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.exchange.optional_imports import require
from layflat.data.session.reader import Session

DEPTH_KEY = "observation.images.depth"
IMAGES = {"observation.images.camera": "obs/rgb", DEPTH_KEY: "obs/depth"}
"""Column of images -> data set."""
STATE = ("obs/corner_positions", "obs/holder_position")
CLOTH = ("obs/word", "obs/word_strength", "obs/contact_portion")
FEATURES_KEY = "huggingface"
"""Key of the parquet files' metadata in which Hugging Face's ``datasets`` looks for the types of columns."""

STATE_NAMES = (
    *(f"corner{corner}_{axis}" for corner in (1, 2) for axis in "xyz"),
    *(f"holder_{axis}" for axis in "xyz"),
)
"""Columns of the robot: m, world frame; corner 1 is the one at +y."""
CLOTH_NAMES = ("word_x", "word_y", "word_strength", "contact_portion")
"""Columns of the cloth, as seen by the camera."""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One column."""

    key: str
    dtype: str
    """Type of a number, or "image"."""
    shape: tuple[int, ...]
    names: Sequence[str] | None = None
    depth: bool = False

    def described(self) -> dict[str, Any]:
        """Return the column as info.json describes it."""
        names = None if self.names is None else list(self.names)
        described: dict[str, Any] = {"dtype": self.dtype, "shape": list(self.shape), "names": names}
        if self.depth:
            described["info"] = {"is_depth_map": True, "depth_unit": "m"}
        return described

    def arrow_type(self) -> Any:
        """Return the column's type for arrow."""
        pa = require("pyarrow")
        if self.dtype == "image":
            return pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        value = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}[self.dtype]
        return value if self.shape == (1,) else pa.list_(value, self.shape[0])

    def hugging_face(self) -> dict[str, Any]:
        """Return the column's type for Hugging Face's ``datasets``."""
        if self.dtype == "image":
            return {"_type": "Image"}
        value = {"dtype": self.dtype, "_type": "Value"}
        return value if self.shape == (1,) else {"feature": value, "length": self.shape[0], "_type": "Sequence"}


def features_of(session: Session, name: str, *, images: bool) -> tuple[Feature, ...]:
    """Return the columns of a session's episodes, by the example of one."""
    group, actions = session.group(name), session.robot.action_names
    features = [
        Feature(key="observation.state", dtype="float32", shape=(len(STATE_NAMES),), names=STATE_NAMES),
        Feature(key="observation.environment_state", dtype="float32", shape=(len(CLOTH_NAMES),), names=CLOTH_NAMES),
    ]
    axes = ("height", "width", "channels")
    for key, source in IMAGES.items():
        if images and source in group:
            shape = group[source].shape[1:]
            features.append(Feature(key=key, dtype="image", shape=shape, names=axes, depth=key == DEPTH_KEY))
    features += [
        Feature(key="action", dtype="float32", shape=(len(actions),), names=actions),
        Feature(key="next.reward", dtype="float32", shape=(1,)),
        Feature(key="next.done", dtype="bool", shape=(1,)),
        Feature(key="timestamp", dtype="float32", shape=(1,)),
    ]
    indices = ("frame_index", "episode_index", "index", "task_index")
    return (*features, *(Feature(key=key, dtype="int64", shape=(1,)) for key in indices))


def frames_of(session: Session, name: str, features: tuple[Feature, ...]) -> dict[str, NDArray[Any]]:
    """Return columns by key, one row for each step of an episode; without times and indices."""
    rows = session.arrays([*STATE, *CLOTH, "action_m", "rewards", "dones"], [name])
    columns: dict[str, NDArray[Any]] = {
        "observation.state": np.hstack([rows[key] for key in STATE]).astype(np.float32),
        "observation.environment_state": np.hstack([rows[key] for key in CLOTH]).astype(np.float32),
        "action": rows["action_m"].astype(np.float32),
        "next.reward": rows["rewards"].astype(np.float32),
        "next.done": rows["dones"].astype(bool),
    }
    for feature in (feature for feature in features if feature.dtype == "image"):
        source = IMAGES[feature.key]
        if source not in session.group(name) or session.group(name)[source].shape[1:] != feature.shape:
            raise DataError(f"{name} has no images of {feature.shape} in {feature.key}; export without images")
        columns[feature.key] = session.array(name, source)
    return columns


def encoded(features: tuple[Feature, ...], columns: Mapping[str, Any]) -> Any:
    """Return the columns as an arrow table with the metadata for ``datasets``."""
    pa = require("pyarrow")
    arrays = []
    for feature in features:
        rows = columns[feature.key]
        if feature.dtype == "image":
            values = [{"bytes": image_file(row, depth=feature.depth), "path": None} for row in rows]
            arrays.append(pa.array(values, feature.arrow_type()))
        elif feature.shape == (1,):
            arrays.append(pa.array(rows, feature.arrow_type()))
        else:
            flat = pa.array(rows.ravel(), feature.arrow_type().value_type)
            arrays.append(pa.FixedSizeListArray.from_arrays(flat, feature.shape[0]))
    described = {"info": {"features": {feature.key: feature.hugging_face() for feature in features}}}
    schema = pa.schema(
        [(feature.key, feature.arrow_type()) for feature in features], metadata={FEATURES_KEY: json.dumps(described)}
    )
    return pa.Table.from_arrays(arrays, schema=schema)


def image_file(image: NDArray[Any], *, depth: bool) -> bytes:
    """Return rgb (H, W, 3) as PNG, depth (H, W, 1) float32 as TIFF; both are lossless."""
    pillow = require("PIL.Image")
    buffer = io.BytesIO()
    if depth:
        pillow.fromarray(np.ascontiguousarray(image[..., 0])).save(buffer, "TIFF", compression="tiff_adobe_deflate")
    else:
        pillow.fromarray(np.ascontiguousarray(image)).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
