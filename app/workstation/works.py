"""Every order that a bench process can be given, by name. A new one adds a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from app.errors import WrongCall
from app.workstation.demonstrating import DemonstratingWork
from app.workstation.host import Desk, MakeWork, Order, Work
from app.workstation.placing import PlacingWork

WORKS: Mapping[str, MakeWork] = {"place": PlacingWork, "record": DemonstratingWork}


def make_work(order: Order, desk: Desk) -> Work:
    """The work of an order, by its ``work``."""
    name = str(order.get("work"))
    if name not in WORKS:
        raise WrongCall(f"the bench knows no work {name!r}; it must be one of {', '.join(WORKS)}")
    return WORKS[name](order, desk)
