"""Requests of the window: what an activity's process is to do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from layflat.data.session.recorder import SessionRecorder
from layflat.policy.spec import PolicySpec
from layflat.policy.trained_model import TrainedModel
from layflat.sim.config import SimConfig


@dataclass(frozen=True, kw_only=True)
class ActivityRequest:
    """Settings that all activities have."""

    sim_config: SimConfig
    seed: int = 0
    speed: float = 1.0
    """Simulated over wall time at most; 0 is as fast as possible."""
    images: bool = False
    """Whether camera images are saved."""
    source: str = ""
    """Teleoperator of the person; empty where there is none."""
    session: Path | None = None
    """Session to record into, or None."""

    def open_recorder(self) -> SessionRecorder | None:
        """Open the session; DataError where it holds something else."""
        if self.session is None:
            return None
        self.session.parent.mkdir(parents=True, exist_ok=True)
        return SessionRecorder(
            self.session,
            robot=self.sim_config.robot_spec,
            cloth=self.sim_config.cloth,
            save_images=self.images,
            descriptor=self.sim_config.descriptor,
        )


@dataclass(frozen=True, kw_only=True)
class RecordRequest(ActivityRequest):
    """Record demonstrations of a person, one after another."""

    countdown_s: float
    episodes: int | None = None
    """Number of episodes to keep; None: until the person quits."""
    disturbance: str = "none"
    """Disturbance that the device's disturb button starts."""
    model: TrainedModel | None = None
    """Policy that places and that the person takes over from, or None."""


@dataclass(frozen=True, kw_only=True)
class PlaceRequest(ActivityRequest):
    """Run one episode of a policy; with a ``source``, a person may take over."""

    policy: PolicySpec
    fast_forward: bool = False
    """Whether to run as fast as possible until the cloth is placed."""
