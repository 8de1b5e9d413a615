"""Placing for a bench process whose bench is a few numbers: everything of the window's but the physics."""

from __future__ import annotations

from typing import Any

from layflat.app.workers.episode_pool import EpisodeJob
from layflat.app.workstation.session import place_task
from layflat.app.workstation.session.bench_process import Desk, Order
from layflat.app.workstation.session.place_task import PlacingWork
from layflat.data.types import Truth
from layflat.policy.base import Policy
from layflat.policy.registry import decorated
from layflat.tests.app.fake_bench import FakeBench, Forward


class LyingBench(FakeBench):
    """Its cloth lies flat where its holder is, so that it can be drawn."""

    def truth(self) -> Truth:
        nodes = self.settings.spec.flat_nodes(x_m=float(self._holder_m[0]))
        return Truth(nodes=nodes, contact_portion_true=self._contact(), flat_area=self._contact())


def _forward(job: EpisodeJob, bench: LyingBench) -> Policy:
    return decorated(Forward(enough=2.0), job.decorators)


def make_fake(order: Order, desk: Desk) -> PlacingWork:
    """The order's work with ``forward`` as the policy, whatever it says."""
    replaced: dict[str, Any] = {"Placing": LyingBench, "policy_of": _forward}
    for name, value in replaced.items():
        setattr(place_task, name, value)
    return PlacingWork(order, desk)
