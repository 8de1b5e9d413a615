"""Errors of the operating system in words, with what helps; most are passing states, not damage."""

from __future__ import annotations

import errno
import os
import re

_ERRNO = re.compile(r"errno = (\d+)")

UNSUPPORTED = frozenset({errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS})
"""Errors of a file system that does not support a call, such as flushing a folder, which only local disks can."""
NO_LOCKS = UNSUPPORTED | {errno.ENOLCK, errno.EBADF}
"""The same of locks, which some network drives lack, or refuse for a file that is open for reading."""

_GONE = "the drive is no longer connected: connect it again"
ADVICE = {
    errno.ENOENT: "check the path",
    errno.EACCES: "check its permissions, or choose another place",
    errno.EPERM: "check its permissions, or choose another place",
    errno.EISDIR: "give the name of a file",
    errno.ENOTDIR: "a part of its path is a file: check the path",
    errno.EEXIST: "choose another name",
    errno.EROFS: "the disk is read-only: choose another place",
    errno.ENAMETOOLONG: "give a shorter name",
    errno.ELOOP: "a link leads to itself: check the path",
    errno.ENOSPC: "free some space, or choose another place",
    errno.EDQUOT: "your quota is full: free some space, or choose another place",
    errno.EFBIG: "this disk or `ulimit -f` allows no file of that size: choose another place, or raise the limit",
    errno.EBUSY: "another program uses it: close it there",
    errno.ETXTBSY: "another program uses it: close it there",
    errno.EMFILE: "too many files are open: raise the limit (`ulimit -n 4096`)",
    errno.ENFILE: "too many files are open on this machine: close other programs",
    errno.ENOMEM: "memory ran out: close other programs, or use fewer --workers",
    errno.EAGAIN: "a limit is reached, often that on processes: close other programs, or use fewer --workers",
    errno.EIO: "the disk reports an error: check it, and copy what is on it to another one",
    errno.ETIMEDOUT: "the network drive does not answer: connect it again, or choose another place",
    **dict.fromkeys((errno.ESTALE, errno.ENOTCONN, errno.ENODEV, errno.ENXIO, errno.EHOSTDOWN), _GONE),
}
"""Advice by number of the error."""


def errno_of(error: BaseException) -> int | None:
    """Return the number of an error, also where HDF5 has wrapped it in its own; None where there is none."""
    number = getattr(error, "errno", None)
    return number or next((int(found) for found in _ERRNO.findall(str(error)) if found != "0"), None)


def os_reason(error: BaseException) -> str:
    """Return the operating system's text for an error, and in brackets what to do about it."""
    number = errno_of(error)
    if number is None:
        return (str(error).splitlines() or ["unknown error"])[0]
    return os.strerror(number) + (f" ({ADVICE[number]})" if number in ADVICE else "")
