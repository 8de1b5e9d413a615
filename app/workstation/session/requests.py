"""What an order of the window says: of which bench, which model, and where it goes."""

from __future__ import annotations

from pathlib import Path

from layflat.app.workstation.session.bench_process import Request
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io as model_files
from layflat.policy.trained_model import TrainedModel
from layflat.sim.config import SimConfig


def model_of(policy: str) -> TrainedModel | None:
    """The model of a path; None for a policy that has none."""
    return model_files.load(Path(policy)) if policy.endswith(".npz") else None


def settings_of(order: Request, *, descriptor: str | None) -> SimConfig:
    return SimConfig(
        robot=order["robot"],
        cloth=str(order["cloth"]),
        descriptor=descriptor or str(order["descriptor"]),
        noise=bool(order["noise"]),
        step_s=float(order["step_s"]),
    )


def recorder_of(order: Request, settings: SimConfig) -> SessionRecorder | None:
    """Where the order records; DataError where that session holds something else."""
    path = str(order.get("record") or "")
    if not path:
        return None
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    return SessionRecorder(
        path,
        robot=settings.robot_spec,
        cloth=settings.cloth,
        save_images=bool(order.get("images")),
        descriptor=settings.descriptor,
    )
