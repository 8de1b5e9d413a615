"""The messages between Layflat and a policy server: msgpack with numpy arrays, as openpi's servers speak it.

An observation is a flat dictionary with the names of ``obs`` in a session file, in its units and float64. Beside them
stand the episode's ``robot``, ``task``, ``cloth``, ``seed``, ``step`` (from 0), ``resumed`` (the first step after a
disturbance) and ``prompt``. The answer's ``actions`` are (T, A), the next T steps, or (A,).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np

from layflat.data.types import Observation
from layflat.policy.base import PolicyError

MAX_BYTES = 64_000_000
"""Longest message that is read."""
ACTIONS, ACTION_UNIT = "actions", "action_unit"
METRES = "m"
"""Value of ACTION_UNIT in the metadata of a server whose actions are in metres; others use -1..1, as gymnasium does."""
PROMPT = "lay the cloth flat on the table"


def pack(message: Mapping[str, Any]) -> bytes:
    """Return a message as bytes."""
    return bytes(msgpack.packb(message, default=_encode))


def unpack(data: bytes | str) -> dict[str, Any]:
    """Return the dictionary of a message; PolicyError where it is something else."""
    try:
        if isinstance(data, str):
            raise ValueError(data[-200:])
        message = msgpack.unpackb(data, object_hook=_decode, strict_map_key=False)
    except (LookupError, ValueError, TypeError, msgpack.UnpackException) as error:
        raise PolicyError(f"a message is not msgpack with numpy arrays: {' '.join(str(error).split())}") from error
    if not isinstance(message, dict):
        raise PolicyError(f"a message is a {type(message).__name__}; it must be a dictionary")
    return message


def _encode(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufSU":
        return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": value.shape}
    if isinstance(value, np.generic):
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"a {type(value).__name__} cannot be sent")


def _decode(value: dict[Any, Any]) -> Any:
    if b"__ndarray__" in value:
        dtype = np.dtype(str(value[b"dtype"]))
        if dtype.kind not in "biufSU":
            raise ValueError(f"arrays of type {dtype} are not taken")
        return np.frombuffer(value[b"data"], dtype).reshape(value[b"shape"])
    if b"__npgeneric__" in value:
        return np.dtype(str(value[b"dtype"])).type(value[b"data"])
    return value


def encode_observation(observation: Observation, *, images: bool) -> dict[str, Any]:
    """Return an observation as a dictionary; ``free_edge_m`` and the images only where it has them."""
    message: dict[str, Any] = {
        "time_s": np.array([observation.time_s]),
        "corner_positions": observation.corner_positions.reshape(6),
        "holder_position": observation.holder_position,
        "word": observation.word,
        "word_strength": np.array([observation.word_strength]),
        "contact_portion": np.array([observation.contact_portion]),
    }
    if observation.free_edge_m is not None:
        message["free_edge_m"] = observation.free_edge_m
    if images and observation.rgb is not None and observation.depth is not None:
        message |= {"rgb": observation.rgb, "depth": observation.depth[:, :, None]}
    return message


def decode_observation(message: Mapping[str, Any]) -> Observation:
    """Return the observation of a dictionary; PolicyError where a field is missing or wrong."""
    try:
        depth = message.get("depth")
        return Observation(
            corner_positions=np.reshape(message["corner_positions"], (2, 3)),
            holder_position=message["holder_position"],
            word=message["word"],
            **{name: float(np.squeeze(message[name])) for name in ("time_s", "word_strength", "contact_portion")},
            free_edge_m=message.get("free_edge_m"),
            rgb=message.get("rgb"),
            depth=None if depth is None else np.squeeze(depth, -1),
        )
    except KeyError as error:
        raise PolicyError(f"the observation has no {error.args[0]}") from error
    except (TypeError, ValueError) as error:
        raise PolicyError(f"the observation is wrong: {error}") from error
