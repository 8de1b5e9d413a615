"""Placing for a bench process whose bench is a few numbers: everything of the window's but the physics."""

from __future__ import annotations

from typing import Any

from app.jobs import EpisodeJob
from app.workstation import placing
from app.workstation.host import Desk, Order
from app.workstation.placing import PlacingWork
from data.types import Truth
from policy.base import Policy
from policy.registry import decorated
from tests.app.fake_bench import FakeBench, Forward


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
        setattr(placing, name, value)
    return PlacingWork(order, desk)
