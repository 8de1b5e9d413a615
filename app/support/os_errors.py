"""What the operating system's errors mean for a person, and what to do about them."""

from __future__ import annotations

import errno

WRONG_CALL = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError, FileExistsError)
"""A path that cannot be used is a wrong call; any other error is failed work."""
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
    errno.EFBIG: "the limit on the size of files is reached: raise it (`ulimit -f`), or choose another place",
    errno.EMFILE: "too many files are open: raise the limit (`ulimit -n 4096`)",
    errno.ENFILE: "too many files are open on this machine: close other programs",
    errno.ENOMEM: "memory ran out: close other programs, or use fewer --workers",
    errno.EAGAIN: "a limit is reached, often that on processes: close other programs, or use fewer --workers",
    errno.EIO: "the disk reports an error: check it, and choose another place",
    errno.ESTALE: "the network drive has lost it: connect it again",
    errno.ETIMEDOUT: "the network drive does not answer: connect it again, or choose another place",
}


def describe_os_error(error: OSError) -> tuple[str, bool]:
    """Return one sentence with what is wrong and what to do, and whether the call was wrong."""
    reason = error.strerror or " ".join(str(error).split()) or type(error).__name__
    what = f"{error.filename}: {reason}" if error.filename else reason
    advice = ADVICE.get(error.errno or 0, "run it again with --debug, and report the output if it stays")
    return f"{what}; {advice}", isinstance(error, WRONG_CALL)
