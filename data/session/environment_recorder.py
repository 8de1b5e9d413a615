"""Recorders of the sessions of an environment."""

from __future__ import annotations

from pathlib import Path

from layflat.data.environment_spec import EnvironmentSpec
from layflat.data.session.recorder import SessionRecorder


def recorder_for(path: Path, spec: EnvironmentSpec, *, save_images: bool = False) -> SessionRecorder:
    """Open a session for episodes of an environment; DataError where it cannot be written or holds those of others."""
    return SessionRecorder(
        path,
        robot=spec.robot,
        task=spec.task,
        cloth=spec.cloth,
        physics=spec.physics,
        descriptor=spec.descriptor,
        save_images=save_images,
    )
