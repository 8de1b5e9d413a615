"""Placing for a bench process whose bench is a few numbers: everything of the window's but the physics."""

from __future__ import annotations

from typing import Any

from layflat.app.workers.episode_pool import EpisodeConfig
from layflat.app.workstation.session import place_task
from layflat.app.workstation.session.bench_process import Endpoint, Request
from layflat.app.workstation.session.place_task import PlaceTask
from layflat.data.types import GroundTruth
from layflat.policy.base import Policy
from layflat.policy.registry import wrap
from layflat.tests.fake_environment import FakeEnvironment, ForwardPolicy


class LyingBench(FakeEnvironment):
    """Its cloth lies flat where its holder is, so that it can be drawn."""

    def ground_truth(self) -> GroundTruth:
        nodes = self.config.cloth_spec.flat_nodes(x_m=float(self._holder_m[0]))
        return GroundTruth(nodes=nodes, contact_portion_true=self._contact(), flat_area=self._contact())


def _forward(job: EpisodeConfig, bench: LyingBench) -> Policy:
    return wrap(ForwardPolicy(enough=2.0), job.decorators)


def make_fake(order: Request, desk: Endpoint) -> PlaceTask:
    """The order's work with ``forward`` as the policy, whatever it says."""
    replaced: dict[str, Any] = {"Placing": LyingBench, "policy_of": _forward}
    for name, value in replaced.items():
        setattr(place_task, name, value)
    return PlaceTask(order, desk)
