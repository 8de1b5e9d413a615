"""An evaluation of made-up episodes, and its page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.report.evaluation_page import PageOptions, evaluation_page
from layflat.app.report.page import write_page
from layflat.app.support.metrics import episode_metrics
from layflat.data.types import GroundTruth
from layflat.sim.cloth.registry import cloth_spec

POLICIES = ("gp-baseline", "gp-word", "gp-baseline+drag-rule")
CONDITIONS = (("hanger", False), ("pickers", True))
SEEDS = range(6)
NUMBERS = ("contact_final", "contact_disturbed", "flat_area_final", "steps", "sim_s")


class FakeResults:
    """An evaluation of made-up episodes; the last one crashed."""

    def __init__(self, episodes):
        self.episodes = {f"{e.robot}--{e.source}--{e.seed}--{e.disturbance}": e for e in episodes}
        rows = [episode_metrics(e) | {"run": run, "reason": ""} for run, e in self.episodes.items()]
        rows[-1] |= dict.fromkeys(("contact_final", "contact_disturbed", "flat_area_final", "steps", "sim_s"))
        rows[-1] |= {"crashed": True, "stopped_by": "crashed", "reason": "its process ended with status -11"}
        self.rows = pd.DataFrame(rows).astype(dict.fromkeys(NUMBERS, float))

    def episode(self, run):
        assert self.rows.set_index("run").loc[run, "crashed"] == False, "a crashed episode has no record"  # noqa: E712
        return self.episodes[run]


def with_nodes(episode, *, lift_m=0.15):
    """Give the episode a towel whose part that is not in contact stands up from the table, towards the held edge."""
    spec = cloth_spec(episode.cloth)
    flat = spec.flat_nodes(x_m=0.25)
    along = (flat[:, 0] - flat[:, 0].min()) / np.ptp(flat[:, 0])

    def ground_truth(old, contact):
        nodes = flat.copy()
        nodes[:, 2] += lift_m * np.clip(along - contact, 0, None)
        return GroundTruth(nodes=nodes, contact_portion_true=old.contact_portion_true, flat_area=old.flat_area)

    contact = episode.contact()
    steps = tuple(
        replace(step, ground_truth=ground_truth(step.ground_truth, contact[step_index]))
        for step_index, step in enumerate(episode.steps)
    )
    return replace(episode, steps=steps, final_ground_truth=ground_truth(episode.final_ground_truth, contact[-1]))


@pytest.fixture(scope="session")
def batch(make_episode):
    gains = {"gp-baseline": 0.0, "gp-word": 0.11, "gp-baseline+drag-rule": 0.105}
    return FakeResults(
        with_nodes(
            make_episode(
                robot=robot, source=policy, seed=seed, disturbed=disturbed, gain=gains[policy] + 0.005 * (seed % 3)
            )
        )
        for robot, disturbed in CONDITIONS
        for policy in POLICIES
        for seed in SEEDS
    )


@pytest.fixture(scope="session")
def content(batch):
    """The page, made once for all tests; its films are made when it is written."""
    title, provenance = "An evaluation of made-up <episodes>", ("layflat evaluate", "numpy 2")
    with EpisodeRenderer() as renderer:
        yield evaluation_page(batch, renderer, PageOptions(films=2), title=title, provenance=provenance)


@pytest.fixture(scope="session")
def page(content, tmp_path_factory):
    """The page as a file."""
    path = tmp_path_factory.mktemp("evaluation") / "report.html"
    write_page(path, content)
    return path
