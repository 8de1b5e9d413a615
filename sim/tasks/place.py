"""The task ``place``: lay a cloth flat on the table (chapter 4)."""

from __future__ import annotations

from layflat.sim.tasks.base import Task

PLACE = Task(name="place", starts=("hanging", "folded-corner", "swinging", "crumpled"), demonstrator="scripted")
