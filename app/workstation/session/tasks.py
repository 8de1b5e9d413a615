"""Every order that a bench process can be given, by name. A new one adds a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from layflat.app.support.errors import WrongCall
from layflat.app.workstation.session.bench_process import Desk, MakeWork, Order, Work
from layflat.app.workstation.session.place_task import PlacingWork
from layflat.app.workstation.session.record_task import DemonstratingWork

WORKS: Mapping[str, MakeWork] = {"place": PlacingWork, "record": DemonstratingWork}


def make_work(order: Order, desk: Desk) -> Work:
    """The work of an order, by its ``work``."""
    name = str(order.get("work"))
    if name not in WORKS:
        raise WrongCall(f"the bench knows no work {name!r}; it must be one of {', '.join(WORKS)}")
    return WORKS[name](order, desk)
