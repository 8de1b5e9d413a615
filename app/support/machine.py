"""Cores and memory that this process may use, also in a container or a batch job, by the limits of its control group.

Only the standard library is needed.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

GROUPS = Path("/sys/fs/cgroup")
MEMBERSHIP = Path("/proc/self/cgroup")
WORKER_BYTES = 250_000_000
"""Memory of a worker that keeps images, about 200 MB, and likewise of the process that starts them."""


def available_cores() -> int:
    """Return the number of cores that this process may use; a part of one counts as one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    shares = [float(quota) / float(period) for quota, period in _cpu_quotas() if quota not in ("max", "-1")]
    return max(1, min([cores, *map(math.ceil, shares)]))


def memory_bytes() -> int | None:
    """Return the memory that this process may use, the machine's at most; None where it is not known."""
    try:
        sizes = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    except (AttributeError, OSError, ValueError):
        return None
    limits = [*_values("memory", "memory.limit_in_bytes"), *_values("", "memory.max")]
    return min(sizes + [int(limit) for limit in limits if limit != "max"])


def memory_limit_bytes() -> int | None:
    """Return the memory limit of the control group; None where there is only the machine's own."""
    size = memory_bytes()
    return None if size is None or size == os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") else size


def default_workers() -> int:
    """Return how many workers there are cores and memory for, at least one."""
    size = memory_bytes()
    return available_cores() if size is None else max(1, min(available_cores(), size // WORKER_BYTES - 1))


def _cpu_quotas() -> Iterator[list[str]]:
    """Yield quota and period of the groups that have them."""
    yield from (text.split() for text in _values("", "cpu.max"))
    quotas, periods = (_values("cpu", f"cpu.cfs_{name}_us") for name in ("quota", "period"))
    yield from ([quota, period] for quota, period in zip(quotas, periods, strict=False))


def _values(controller: str, name: str) -> list[str]:
    """Return what a file holds in this process's group and in those around it; ``controller`` is "" for version 2."""
    texts = []
    for folder in _folders(controller):
        try:
            texts.append((folder / name).read_text(encoding="ascii").strip())
        except (OSError, UnicodeDecodeError):
            continue
    return [text for text in texts if text]


def _folders(controller: str) -> list[Path]:
    """Return the folders of the group, from the innermost; a container may see its own as the outermost."""
    try:
        lines = MEMBERSHIP.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controller in controllers.split(","):
            roots = [GROUPS / controller] if controller else [GROUPS, GROUPS / "unified"]
            inner = Path(path.lstrip("/"))
            return [root / folder for root in roots for folder in (inner, *inner.parents)]
    return []
