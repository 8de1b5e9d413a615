"""Superblock of HDF5 files: its mark of a file that is open for writing, and the length that it claims.

Files of HDF5's newest format (superblock 3) carry a mark while a program has them open for writing. A program that is
killed leaves the mark behind, and HDF5 then refuses the file although nothing in it need be wrong.
"""

from __future__ import annotations

import struct
from pathlib import Path

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_VERSION, _FLAGS, _EOF, _CHECKSUM, _SIZE = 8, 11, 28, 44, 48
"""Offsets in superblocks of version 2 and 3 with addresses of eight bytes, and their size."""
_EIGHT_BYTES = b"\x08\x08"
_MASK = 0xFFFFFFFF


def head_of(path: Path) -> bytes:
    """Return the bytes of a file's superblock, fewer where it is shorter."""
    with path.open("rb") as file:
        return file.read(_SIZE)


def is_marked(head: bytes) -> bool:
    """Return whether an intact superblock says that a program has the file open for writing."""
    return _is_intact(head) and head[_VERSION] == 3 and head[_FLAGS] != 0


def without_mark(head: bytes) -> bytes:
    """Return an intact superblock without the mark."""
    cleared = head[:_FLAGS] + b"\0" + head[_FLAGS + 1 : _CHECKSUM]
    return cleared + struct.pack("<I", lookup3(cleared))


def claimed_length(head: bytes, real_length: int) -> int | None:
    """Return the file's length by its superblock where it is more than the real length, but not absurdly more."""
    if len(head) < _SIZE or not head.startswith(SIGNATURE) or head[_VERSION] not in (2, 3):
        return None
    (length,) = struct.unpack_from("<Q", head, _EOF)
    return int(length) if real_length < length <= 64 * real_length + (1 << 24) else None


def _is_intact(head: bytes) -> bool:
    if len(head) < _SIZE or not head.startswith(SIGNATURE) or head[_VERSION + 1 : _FLAGS] != _EIGHT_BYTES:
        return False
    return struct.pack("<I", lookup3(head[:_CHECKSUM])) == head[_CHECKSUM:_SIZE]


def lookup3(data: bytes) -> int:
    """Return HDF5's checksum of metadata: Bob Jenkins's ``hashlittle`` of lookup3, with 0 to start with."""
    a = b = c = (0xDEADBEEF + len(data)) & _MASK
    blocks = [data[at : at + 12] for at in range(0, len(data), 12)]
    for block in blocks[:-1]:
        x, y, z = struct.unpack("<3I", block)
        a, b, c = _mix((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)
    if not blocks:
        return c
    x, y, z = struct.unpack("<3I", blocks[-1].ljust(12, b"\0"))
    return _final((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)


def _rotated(value: int, bits: int) -> int:
    return (value << bits | value >> (32 - bits)) & _MASK


def _mix(a: int, b: int, c: int) -> tuple[int, int, int]:
    for bits in (4, 6, 8, 16, 19, 4):
        a = (a - c) & _MASK ^ _rotated(c, bits)
        c = (c + b) & _MASK
        a, b, c = b, c, a
    return a, b, c


def _final(a: int, b: int, c: int) -> int:
    for bits in (14, 11, 25, 16, 4, 14, 24):
        c = ((c ^ b) - _rotated(b, bits)) & _MASK
        a, b, c = b, c, a
    return b
