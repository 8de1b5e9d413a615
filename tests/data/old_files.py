"""What the files of older versions hold, said anew.

version-1.h5: by layflat 0.1.0 of ``make_episode(steps=3, seed=s, nodes=4, images=True, with_std=s == 1)``, s = 0, 1.
version-2.h5: by layflat 0.2 (commit 02851cf) of version_2_episodes; version-2.journal: of version_2_episode(..., 3),
closed before its end was said.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from layflat.data.types import DisturbanceRecord

FILES = Path(__file__).parent / "files"
PLAN = {"nodes": [1, 2], "path_m": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.02]]}
DISTURBED = ("place", "place", "disturb", "disturb", "repair")


def version_2_episode(make_episode, seed, phases=DISTURBED, last_step=3, **changes):
    """Disturbed from its third step on."""
    first = phases.index("disturb")
    befell = DisturbanceRecord(name="push", first_step=first, last_step=last_step, plan=PLAN)
    episode = make_episode(n_steps=len(phases), seed=seed, nodes=4, with_std=bool(seed), disturbance="push", **changes)
    steps = [replace(step, phase=phase) for step, phase in zip(episode.steps, phases, strict=True)]
    return replace(episode, steps=steps, disturbances=[befell])


def version_2_episodes(make_episode):
    """Disturbed and repaired; not disturbed; diverged while disturbed, so that it was never over."""
    unstable = {"stopped_by": "unstable", "outcome": "failure"}
    return [
        version_2_episode(make_episode, 0),
        make_episode(n_steps=3, seed=1, nodes=4, with_std=True),
        version_2_episode(make_episode, 2, phases=("place", "disturb", "disturb"), last_step=None, **unstable),
    ]
