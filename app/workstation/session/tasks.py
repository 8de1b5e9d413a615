"""Every order that a bench process can be given, by name. A new one adds a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from layflat.app.support.errors import UsageError
from layflat.app.workstation.session.bench_process import BenchTask, Endpoint, Request, TaskFactory
from layflat.app.workstation.session.place_task import PlaceTask
from layflat.app.workstation.session.record_task import RecordTask

TASKS: Mapping[str, TaskFactory] = {"place": PlaceTask, "record": RecordTask}


def make_task(order: Request, desk: Endpoint) -> BenchTask:
    """The work of an order, by its ``work``."""
    name = str(order.get("work"))
    if name not in TASKS:
        raise UsageError(f"the bench knows no work {name!r}; it must be one of {', '.join(TASKS)}")
    return TASKS[name](order, desk)
