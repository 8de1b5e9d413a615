"""Index of a session file: the info of each demo in one data set, so that opening need not touch them all.

It is a copy, trusted only between opening a file and reading an episode: an episode is checked against the schema and
against its row when it is read. An index that is missing, damaged or of other demos than those in the file is ignored;
every demo is then checked at once.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import h5py
import numpy as np

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import set_attributes
from layflat.data.format.demo_info import DemoInfo, info_from_row
from layflat.data.format.encode import PACKING
from layflat.data.format.measures import Measures
from layflat.data.format.structure_checks import check_claim, check_demo, check_stored_here, stored_digest

CHUNK_BYTES = 1 << 16


@dataclass(frozen=True, kw_only=True)
class IndexRow:
    """One demo of the index."""

    info: DemoInfo
    digest: str
    """Checksum of the demo's attributes."""
    content: str | None = None
    """Digest of `layflat.data.format.content`; None where it was not computed."""
    measures: Measures | None = None
    """None where they were not computed."""


def row_of(group: h5py.Group, *, file_bytes: int) -> IndexRow:
    """Check a demo and return its row."""
    return IndexRow(info=check_demo(group, file_bytes=file_bytes), digest=stored_digest(group))


def read_index(file: h5py.File, names: Sequence[str], *, file_bytes: int) -> dict[str, IndexRow] | None:
    """Return the rows by name, or None where the index is not of exactly these demos."""
    if schema.INDEX not in file:
        return None
    try:
        lines = _lines(file[schema.INDEX], file_bytes)
        rows = {str(line["name"]): _row_of_line(line) for line in lines}
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, MemoryError):
        return None
    return rows if len(lines) == len(names) and rows.keys() == set(names) else None


def append_index(file: h5py.File, rows: Mapping[str, IndexRow]) -> None:
    """Add rows to the index of a file that is open for writing; create it where there is none."""
    lines = (
        {
            "name": name,
            "digest": row.digest,
            "content": row.content,
            "measures": row.measures and row.measures.to_json(),
            **vars(row.info),
        }
        for name, row in rows.items()
    )
    text = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines).encode("ascii")
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
        set_attributes(file[schema.INDEX], {schema.DESCRIPTION: schema.INDEX_DESCRIPTION})
    index = file[schema.INDEX]
    end = len(index)
    index.resize((end + len(text),))
    index[end:] = np.frombuffer(text, np.uint8)


def _row_of_line(line: Mapping[str, object]) -> IndexRow:
    content = line.get("content")
    return IndexRow(
        info=info_from_row(line),
        digest=str(line["digest"]),
        content=content if isinstance(content, str) else None,
        measures=Measures.from_json(line.get("measures")),
    )


def _lines(index: h5py.Dataset, file_bytes: int) -> list[dict[str, object]]:
    check_stored_here(index, index.name)
    check_claim(index, index.name, file_bytes)
    lines = json.loads(b"[" + b",".join(bytes(index[()]).splitlines()) + b"]")
    if not all(isinstance(line, dict) for line in lines):
        raise DataError("a line of the index is no JSON object")
    return list(lines)
