"""What an order of the window says: of which bench, which model, and where it goes."""

from __future__ import annotations

from pathlib import Path

from app.workstation.host import Order
from data.recorder import SessionRecorder
from policy import model as model_files
from policy.learned import Learned
from sim.settings import BenchSettings


def model_of(policy: str) -> Learned | None:
    """The model of a path; None for a policy that has none."""
    return model_files.load(Path(policy)) if policy.endswith(".npz") else None


def settings_of(order: Order, *, descriptor: str | None) -> BenchSettings:
    return BenchSettings(
        task=order["task"],
        cloth=str(order["cloth"]),
        descriptor=descriptor or str(order["descriptor"]),
        noise=bool(order["noise"]),
        tick_s=float(order["tick_s"]),
    )


def recorder_of(order: Order, settings: BenchSettings) -> SessionRecorder | None:
    """Where the order records; DataError where that session holds something else."""
    path = str(order.get("record") or "")
    if not path:
        return None
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    return SessionRecorder(
        path,
        task=settings.task,
        cloth=settings.cloth,
        keep_images=bool(order.get("images")),
        descriptor=settings.descriptor,
    )
