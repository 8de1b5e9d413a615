"""Model files: an ``.npz`` of plain arrays with a JSON header; no pickle, no class names, nothing executable.

The file is a zip of ``header.npy`` (the JSON as bytes) and one ``.npy`` for each array that the model's method names,
little-endian float64. The header holds the method's format, a schema version, the shapes, everything that a rollout
needs, and a SHA-256 over itself and the arrays. The checksum finds damage and careless edits; it is not a signature.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.atomic_files import write_bytes
from layflat.data.robot import RobotSpec
from layflat.data.system_errors import os_reason
from layflat.data.types import Provenance
from layflat.policy.base import PolicyError
from layflat.policy.features import WORLD, FeatureLayout
from layflat.policy.registry import LEARNERS
from layflat.policy.trained_model import TrainedModel

FORMATS: Mapping[str, type[TrainedModel]] = {learner.model.FORMAT: learner.model for learner in LEARNERS.values()}
"""Model class for each format that a header may name."""
SCHEMA = 1

MAX_FILE_BYTES = 64 * 2**20
MAX_HEADER_BYTES = 2**20
MAX_POINTS = 20_000
"""No fit makes more; the kernel matrices alone would be 3 GB for each output."""

_SCALARS: Mapping[str, type] = {
    **dict.fromkeys(("policy", "task", "cloth", "descriptor"), str),
    **dict.fromkeys(("step_s", "action_limit_m", "stop_threshold_m"), float),
    **dict.fromkeys(("stop_steps", "seed", "demonstrations", "points_available"), int),
}
"""Fields of every model that are stored in the header as they are."""


class ModelWriteError(PolicyError):
    """A model file could not be written, because of the disk or the system."""

    exit_status = 1
    """Exit status of the program: the work failed, the call was right."""


def save(model: TrainedModel, path: str | Path, *, force: bool = False) -> None:
    """Write a model file (``.npz``), completely or not at all.

    PolicyError if it cannot be written, or exists and ``force`` does not allow to replace it.
    """
    target = Path(path)
    if target.exists() and not force:
        raise PolicyError(f"{target} exists already; choose another name or force overwriting it")
    arrays = {name: np.ascontiguousarray(array, dtype="<f8") for name, array in model.arrays().items()}
    header = _header_of(model, arrays)
    header["checksum"] = checksum(header, arrays)
    text = json.dumps(header, indent=1, sort_keys=True, allow_nan=False).encode()
    buffer = io.BytesIO()
    members: dict[str, Any] = {"header": np.frombuffer(text, dtype=np.uint8), **arrays}
    np.savez(buffer, **members)
    try:
        write_bytes(target, buffer.getvalue())
    except OSError as error:
        raise ModelWriteError(f"cannot write {target}: {os_reason(error)}") from error


def load(path: str | Path) -> TrainedModel:
    """Read a file that `save` wrote; the model predicts the same bits as the saved one.

    PolicyError if the file is missing, is not a model file of this schema, or has been damaged or changed.
    """
    source = Path(path)
    try:
        if source.stat().st_size > MAX_FILE_BYTES:
            raise PolicyError(f"it has {source.stat().st_size} bytes; a model has at most {MAX_FILE_BYTES}")
        with zipfile.ZipFile(source) as archive:
            header = _read_header(archive)
            shapes, kind = header["shapes"], FORMATS[header["format"]]
            names = [name for name in (*kind.ARRAYS, *kind.OPTIONAL) if name in shapes]
            arrays = {name: _read_array(archive, name, shapes[name]) for name in names}
        if header["checksum"] != checksum(header, arrays):
            raise PolicyError("its checksum does not match: it was damaged or changed; train it again")
        return _model_of(header, arrays)
    except (FileNotFoundError, IsADirectoryError) as error:
        wrong = "is not a file" if source.exists() else "does not exist"
        raise PolicyError(f"{source} {wrong}; give a model that `layflat train` wrote") from error
    except zipfile.BadZipFile as error:
        raise PolicyError(f"{source} is not a model file, or only a part of one ({error})") from error
    except OSError as error:
        raise PolicyError(f"cannot read {source}: {os_reason(error)}") from error
    except ValueError as error:
        # Base of PolicyError and DataError, and of what numpy and json raise for foreign bytes.
        raise PolicyError(f"{source} is not a usable model: {error}") from error
    except (EOFError, KeyError, NotImplementedError, RuntimeError, TypeError, zlib.error) as error:
        raise PolicyError(f"{source} is not a usable model ({type(error).__name__}: {error})") from error


def checksum(header: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> str:
    """Return the SHA-256 over the header without its checksum and over each array's name and bytes, in given order."""
    digest = hashlib.sha256()
    rest = {key: value for key, value in header.items() if key != "checksum"}
    digest.update(json.dumps(rest, sort_keys=True).encode())
    for name, array in arrays.items():
        digest.update(f"\0{name}\0".encode())
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()


def _header_of(model: TrainedModel, arrays: Mapping[str, FloatArray]) -> dict[str, Any]:
    return {
        "format": model.FORMAT,
        "schema": SCHEMA,
        "robot": model.layout.robot.name,
        "action_axes": model.layout.robot.axes_json(),
        "features": list(model.layout.names),
        "frame": model.layout.frame,
        "cloths": [list(cloth) for cloth in model.cloths],
        "shapes": {name: list(array.shape) for name, array in arrays.items()},
        "heldout_rmse_m": None if model.heldout_rmse_m is None else list(model.heldout_rmse_m),
        "taught": [list(each) for each in model.taught],
        "provenance": vars(model.provenance) | {"versions": dict(model.provenance.versions)},
        **{name: kind(getattr(model, name)) for name, kind in _SCALARS.items()},
        **model.settings(),
    }


def _model_of(header: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> TrainedModel:
    """Make a model from a checked header; the model itself checks the numbers."""
    kind, robot = FORMATS[header["format"]], RobotSpec.from_json(header["robot"], header["action_axes"])
    shared = {
        "layout": FeatureLayout(robot=robot, names=tuple(header["features"]), frame=header.get("frame", WORLD)),
        "cloths": header.get("cloths", ()),
        "heldout_rmse_m": header["heldout_rmse_m"],
        "taught": header.get("taught", ()),  # as frame and cloths absent in models of earlier versions
        "provenance": Provenance(**header["provenance"]),
        **{name: _scalar(header, name, of) for name, of in _SCALARS.items()},
    }
    return kind.from_arrays(shared, arrays, {name: _scalar(header, name, of) for name, of in kind.SETTINGS.items()})


def _scalar(header: Mapping[str, Any], name: str, kind: type) -> Any:
    value = header[name]
    if type(value) is not kind:
        raise PolicyError(f"its {name} is {value!r}; it must be of type {kind.__name__}")
    return value


def _read_header(archive: zipfile.ZipFile) -> dict[str, Any]:
    if "header.npy" not in archive.namelist():
        raise PolicyError("it is not a model file: header.npy is missing")
    raw = _read_member(archive, "header", MAX_HEADER_BYTES, "|u1", None)
    header = json.loads(raw.tobytes().decode("utf-8"))
    if not isinstance(header, dict) or header.get("format") not in FORMATS:
        raise PolicyError(f"its header does not say format {' or '.join(FORMATS)}")
    if header.get("schema") != SCHEMA or "action_axes" not in header:
        raise PolicyError("it was written by another version of Layflat; train it again")
    kind, named = FORMATS[header["format"]], set(header["shapes"])
    if not set(kind.ARRAYS) <= named <= {*kind.ARRAYS, *kind.OPTIONAL}:
        raise PolicyError(f"its header has the shapes of {sorted(named)}; it must have {sorted(kind.ARRAYS)}")
    wanted = {f"{name}.npy" for name in ("header", *named)}
    if odd := sorted({info.filename for info in archive.infolist()} ^ wanted):
        raise PolicyError(f"it is not a model file: {odd[0]} is {'missing' if odd[0] in wanted else 'unexpected'}")
    return header


def _read_array(archive: zipfile.ZipFile, name: str, shape: Any) -> FloatArray:
    sizes = tuple(shape)
    if not all(type(size) is int and 0 < size <= MAX_POINTS for size in sizes):
        raise PolicyError(f"its {name} claims the shape {shape}; each size must be in 1..{MAX_POINTS}")
    return _read_member(archive, name, MAX_FILE_BYTES, "<f8", sizes)


def _read_member(
    archive: zipfile.ZipFile, name: str, most_bytes: int, dtype: str, shape: tuple[int, ...] | None
) -> np.ndarray:
    """Read one array, after its claimed size has been compared with the number of bytes in the file."""
    info = archive.getinfo(f"{name}.npy")
    if info.file_size > most_bytes:
        raise PolicyError(f"its {name} has {info.file_size} bytes; at most {most_bytes} are allowed")
    stream = io.BytesIO(archive.read(info))
    if np.lib.format.read_magic(stream) != (1, 0):
        raise PolicyError(f"its {name} is not an array of format 1.0")
    claimed, _, kind = np.lib.format.read_array_header_1_0(stream)
    if kind != np.dtype(dtype) or (shape is not None and claimed != shape):
        raise PolicyError(f"its {name} is {kind} {claimed}; it must be {dtype} {'(n,)' if shape is None else shape}")
    if math.prod(claimed) * kind.itemsize != len(stream.getvalue()) - stream.tell():
        raise PolicyError(f"its {name} claims {claimed} but has another number of bytes")
    stream.seek(0)
    return np.asarray(np.load(stream, allow_pickle=False))
