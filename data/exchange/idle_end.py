"""Length of an episode without its idle end: a demonstrator that waits until the cloth has settled teaches nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from layflat.data.format import schema
from layflat.data.session.edited_demo import trimmed
from layflat.data.session.reader import Session
from layflat.data.types import Episode

IDLE_SHARE = 0.01
"""Largest share of the action limit with which a step counts as idle: 0.2 mm."""
IDLE_KEPT = 1
"""Number of idle steps that stay: a policy learns from them to stop."""


def kept_steps(session: Session, name: str, *, trim_idle: bool) -> int:
    """Return the number of steps to export; with ``trim_idle`` only one of the idle steps at the end counts."""
    n_steps = session.info(name).n_steps
    if not trim_idle:
        return n_steps
    moving = np.flatnonzero((np.abs(session.array(name, schema.ACTIONS)) > IDLE_SHARE).any(axis=1))
    return min(n_steps, int(moving[-1]) + 1 + IDLE_KEPT) if len(moving) else min(n_steps, IDLE_KEPT)


def without_idle_end(episode: Episode, n_steps: int) -> Episode:
    """Return the first ``n_steps`` steps; outcome and reason of the end stay, since only standing still is cut off."""
    return replace(trimmed(episode, 0, n_steps), outcome=episode.outcome, stopped_by=episode.stopped_by)
