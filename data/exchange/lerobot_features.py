"""Columns of a LeRobot data set, and their values for an episode."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.exchange.optional_imports import require
from layflat.data.format import schema
from layflat.data.session.reader import Session
from layflat.data.types import ACTION_LIMIT_M

RGB_KEY, DEPTH_KEY = "observation.images.camera", "observation.images.depth"
IMAGES = {RGB_KEY: f"{schema.OBS}/{schema.RGB}", DEPTH_KEY: f"{schema.OBS}/{schema.DEPTH}"}
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
ACTION_TEXT = (
    f"displacement in the step, share of the limit of {1000 * ACTION_LIMIT_M:g} mm, as the environment takes it"
)


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One column."""

    key: str
    dtype: str
    """Type of a number, or "image"."""
    shape: tuple[int, ...] = (1,)
    names: Sequence[str] | None = None
    text: str = ""
    """Meaning of the column, for the card."""
    info: Mapping[str, Any] = field(default_factory=dict)
    """Unit, frame and the like for info.json, under a key that LeRobot keeps."""

    def described(self) -> dict[str, Any]:
        """Return the column as info.json describes it."""
        names = None if self.names is None else list(self.names)
        described: dict[str, Any] = {"dtype": self.dtype, "shape": list(self.shape), "names": names}
        return described | ({"info": dict(self.info)} if self.info else {})

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


def features_of(
    session: Session, name: str, *, images: bool, depth: bool, camera: Mapping[str, Any]
) -> tuple[Feature, ...]:
    """Return the columns of a session's episodes, by the example of one; ``camera`` describes that of all episodes."""
    actions = session.robot.action_names
    return (
        Feature(
            key="observation.state",
            dtype="float32",
            shape=(len(STATE_NAMES),),
            names=STATE_NAMES,
            text="both held corners and the robot's hand, m, world",
            info={"unit": "m", "frame": "world"},
        ),
        Feature(
            key="observation.environment_state",
            dtype="float32",
            shape=(len(CLOTH_NAMES),),
            names=CLOTH_NAMES,
            text=f"wrinkle direction ({session.descriptor}) on the table, its strength; contact portion, 0..1",
            info={"unit": "1", "frame": "table", "descriptor": session.descriptor},
        ),
        *_image_features(session, name, images=images, depth=depth, camera=camera),
        Feature(
            key="action",
            dtype="float32",
            shape=(len(actions),),
            names=actions,
            text=ACTION_TEXT,
            info={"unit": "share of limit_m", "min": -1.0, "max": 1.0, "limit_m": ACTION_LIMIT_M, "frame": "world"},
        ),
        Feature(key="next.reward", dtype="float32", text="gain of the contact portion in the step"),
        Feature(key="next.done", dtype="bool", text="last step of the episode"),
        Feature(key="next.success", dtype="bool", text="last step of an episode with the outcome success"),
        Feature(key="timestamp", dtype="float32", text="s"),
        *(Feature(key=key, dtype="int64") for key in ("frame_index", "episode_index", "index", "task_index")),
    )


def camera_text(session: Session, name: str) -> str:
    """Return the camera's intrinsics and pose as JSON; empty where it is not known."""
    camera = session.camera_of(name)
    return "" if camera is None else camera.to_json()


def _image_features(
    session: Session, name: str, *, images: bool, depth: bool, camera: Mapping[str, Any]
) -> list[Feature]:
    info: dict[str, Any] = {"camera": dict(camera)} if camera else {}
    texts = {RGB_KEY: (images, "rgb as PNG", info)}
    depth_info = {"is_depth_map": True, "depth_unit": "m", **info}
    texts[DEPTH_KEY] = (depth, "metres along the optical axis as TIFF of float32, 0 = missing", depth_info)
    return [
        Feature(
            key=key,
            dtype="image",
            shape=shape,
            names=("height", "width", "channels"),
            text=text,
            info=described,
        )
        for key, (wanted, text, described) in texts.items()
        if wanted and (shape := session.row_shape(name, IMAGES[key])) is not None
    ]


def frames_of(session: Session, name: str, features: tuple[Feature, ...], *, n_steps: int) -> dict[str, NDArray[Any]]:
    """Return columns by key, one row for each of the first ``n_steps`` steps; without times and indices."""
    info, kept = session.info(name), slice(0, n_steps)

    def stacked(keys: Sequence[str]) -> NDArray[np.float32]:
        rows = [session.array(name, key, kept) for key in keys]
        return np.hstack([values.reshape(n_steps, -1) for values in rows]).astype(np.float32)

    last = np.arange(n_steps) == n_steps - 1
    columns: dict[str, NDArray[Any]] = {
        "observation.state": stacked(STATE),
        "observation.environment_state": stacked(CLOTH),
        "action": stacked([schema.ACTIONS]),
        "next.reward": session.array(name, schema.REWARDS, kept).astype(np.float32),
        "next.done": last,
        "next.success": last & info.success,
    }
    for feature in (feature for feature in features if feature.dtype == "image"):
        source = IMAGES[feature.key]
        if session.row_shape(name, source) != feature.shape:
            raise DataError(f"{name} has no images of {feature.shape} in {feature.key}; export without images")
        columns[feature.key] = session.array(name, source, kept)
    return columns


def encoded(features: tuple[Feature, ...], columns: Mapping[str, Any]) -> Any:
    """Return the columns as an arrow table with the metadata for ``datasets``."""
    pa = require("pyarrow")
    arrays = []
    for feature in features:
        rows = columns[feature.key]
        if feature.dtype == "image":
            values = [{"bytes": image_file(row), "path": None} for row in rows]
            arrays.append(pa.array(values, feature.arrow_type()))
        elif feature.shape == (1,):
            arrays.append(pa.array(rows, feature.arrow_type()))
        else:
            flat = pa.array(rows.ravel(), feature.arrow_type().value_type)
            arrays.append(pa.FixedSizeListArray.from_arrays(flat, feature.shape[0]))
    described = {"info": {"features": {feature.key: feature.hugging_face() for feature in features}}}
    table_schema = pa.schema(
        [(feature.key, feature.arrow_type()) for feature in features], metadata={FEATURES_KEY: json.dumps(described)}
    )
    return pa.Table.from_arrays(arrays, schema=table_schema)


def image_file(image: NDArray[Any]) -> bytes:
    """Return rgb (H, W, 3) as PNG, depth (H, W, 1) float32 as TIFF; both are lossless."""
    pillow = require("PIL.Image")
    buffer = io.BytesIO()
    if image.dtype == np.float32:
        pillow.fromarray(np.ascontiguousarray(image[..., 0])).save(buffer, "TIFF", compression="tiff_adobe_deflate")
    else:
        pillow.fromarray(np.ascontiguousarray(image)).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
