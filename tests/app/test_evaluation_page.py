"""The page of a batch: its numbers are the rows', its pictures the episodes', and a browser shows all of it."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from app.report.evaluation import write_evaluation
from app.rows import row_of
from data.types import Truth
from sim.cloth import cloth_spec

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
POLICIES = ("gp-baseline", "gp-word", "gp-baseline+drag-rule")
SEEDS = range(6)


class Drawn:
    """A batch of drawn episodes; the last one crashed."""

    def __init__(self, episodes):
        self.episodes = {f"{e.task}--{e.source}--{e.seed}--{e.disturbance}": e for e in episodes}
        rows = [row_of(e) | {"run": run, "reason": ""} for run, e in self.episodes.items()]
        rows[-1] |= dict.fromkeys(("contact_final", "contact_disturbed", "flat_area_final", "ticks", "sim_s"))
        rows[-1] |= {"crashed": True, "stopped_by": "crashed", "reason": "its process ended with status -11"}
        self.rows = pd.DataFrame(rows)

    def episode(self, run):
        assert self.rows.set_index("run").loc[run, "crashed"] == False, "a crashed episode has no record"  # noqa: E712
        return self.episodes[run]


def laid(episode, *, lift_m=0.15):
    """The episode with a towel whose part that is not in contact stands up from the table, towards the held edge."""
    spec = cloth_spec(episode.cloth)
    flat = spec.flat_nodes(x_m=0.25)
    along = (flat[:, 0] - flat[:, 0].min()) / np.ptp(flat[:, 0])

    def truth(old, contact):
        nodes = flat.copy()
        nodes[:, 2] += lift_m * np.clip(along - contact, 0, None)
        return Truth(nodes=nodes, contact_portion_true=old.contact_portion_true, flat_area=old.flat_area)

    contact = episode.contact()
    steps = tuple(replace(step, truth=truth(step.truth, contact[tick])) for tick, step in enumerate(episode.steps))
    return replace(episode, steps=steps, final_truth=truth(episode.final_truth, contact[-1]))


@pytest.fixture(scope="module")
def batch(make_episode):
    gains = {"gp-baseline": 0.0, "gp-word": 0.11, "gp-baseline+drag-rule": 0.105}
    return Drawn(
        laid(
            make_episode(
                task=task, source=policy, seed=seed, disturbed=disturbed, gain=gains[policy] + 0.005 * (seed % 3)
            )
        )
        for task in ("hanger", "pickers")
        for disturbed in (False, True)
        for policy in POLICIES
        for seed in SEEDS
    )


@pytest.fixture(scope="module")
def page(batch, tmp_path_factory):
    """The page as a file, for all tests that only read it."""
    path = tmp_path_factory.mktemp("evaluation") / "report.html"
    write_evaluation(path, batch, title="A batch of drawn <episodes>", made=("layflat evaluate", "numpy 2"))
    return path
