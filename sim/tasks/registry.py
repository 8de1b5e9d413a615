"""Every task by its name. A new one adds a file and an entry here."""

from __future__ import annotations

from collections.abc import Mapping

from layflat.sim.errors import SimError
from layflat.sim.tasks.base import Task
from layflat.sim.tasks.place import PLACE
from layflat.sim.tasks.smooth import SMOOTH

TASKS: Mapping[str, Task] = {task.name: task for task in (PLACE, SMOOTH)}
DEFAULT_TASK = PLACE.name


def task_named(name: str) -> Task:
    """Return a task; SimError lists the known names."""
    if name not in TASKS:
        raise SimError(f"unknown task {name!r}; the known ones are {', '.join(TASKS)}")
    return TASKS[name]
