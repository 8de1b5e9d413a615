"""The index of a session file: what is known of each demo, in one data set, so that opening need not touch them all.

It is a copy, trusted only for the time between opening a file and reading an episode: an episode is checked against the
schema and against its line when it is read. An index that is missing, damaged or of other demos than those in the file
is as good as none; every demo is then checked at once.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import h5py
import numpy as np

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.encode import PACKING
from layflat.data.format.structure_checks import check_claim, check_stored_here
from layflat.data.session.demo_info import DemoInfo, info_from_row, info_to_row

CHUNK_BYTES = 1 << 16


@dataclass(frozen=True, kw_only=True)
class IndexLine:
    info: DemoInfo
    digest: str
    """Checksum of the demo's attributes."""


def read_index(file: h5py.File, names: Sequence[str], *, file_bytes: int) -> dict[str, IndexLine] | None:
    """Lines by name for exactly these demos, or None."""
    if schema.INDEX not in file:
        return None
    try:
        rows = _rows(file[schema.INDEX], file_bytes)
        lines = {str(row["name"]): IndexLine(info=info_from_row(row), digest=str(row["digest"])) for row in rows}
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, MemoryError):
        return None
    if len(rows) != len(names) or lines.keys() != set(names):
        return None
    return lines


def append_index(file: h5py.File, lines: Mapping[str, IndexLine]) -> None:
    """Add lines to the index of a file that is open for writing; makes one where there is none."""
    rows = ({"name": name, "digest": line.digest, **info_to_row(line.info)} for name, line in lines.items())
    text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows).encode("ascii")
    if schema.INDEX not in file:
        file.create_dataset(
            schema.INDEX,
            shape=(0,),
            maxshape=(None,),
            dtype="|u1",
            chunks=(CHUNK_BYTES,),
            fletcher32=True,
            **PACKING,
        )
    index = file[schema.INDEX]
    end = len(index)
    index.resize((end + len(text),))
    index[end:] = np.frombuffer(text, np.uint8)


def _rows(index: h5py.Dataset, file_bytes: int) -> list[dict[str, object]]:
    check_stored_here(index, index.name)
    check_claim(index, index.name, file_bytes)
    lines = bytes(index[()]).splitlines()
    rows = json.loads(b"[" + b",".join(lines) + b"]")
    if not all(isinstance(row, dict) for row in rows):
        raise DataError("a line of the index is no JSON object")
    return list(rows)
