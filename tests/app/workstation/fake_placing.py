"""PlaceActivity on a few numbers instead of physics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from layflat.app.workstation.session.activity_process import Endpoint
from layflat.app.workstation.session.place_activity import PlaceActivity
from layflat.app.workstation.session.requests import PlaceRequest
from layflat.data.arrays import FloatArray
from layflat.data.environment_spec import StepLimits
from layflat.data.types import GroundTruth
from layflat.policy.base import Policy
from layflat.policy.registry import wrap
from layflat.sim.config import SimConfig
from layflat.tests.fake_environment import FakeEnvironment, ForwardPolicy


class FlatEnvironment(FakeEnvironment):
    """Its cloth lies flat where the robot is, so that it can be drawn."""

    cloth_state = drag_target = None

    def __init__(self, config: SimConfig, **limits: int) -> None:
        super().__init__(config)
        self.spec = replace(self.spec, limits=StepLimits(**limits))

    def ground_truth(self) -> GroundTruth:
        nodes = self.config.cloth_spec.flat_nodes(x_m=float(self.holder_m[0]))
        return GroundTruth(nodes=nodes, contact_portion_true=self.contact, flat_area=self.contact)

    def joint_angles(self) -> FloatArray:
        return np.zeros(7)

    def hand_positions(self) -> FloatArray:
        return np.zeros((0, 3))


@dataclass(frozen=True)
class FakePolicySpec:
    """PolicySpec whose policy moves forward until contact is ``enough``."""

    policy: ForwardPolicy
    wrappers: tuple[str, ...] = ()

    def make(self, env: Any) -> Policy:
        return wrap(self.policy, self.wrappers)


def make_fake(request: PlaceRequest, endpoint: Endpoint) -> PlaceActivity:
    """Make the activity of a request, with ``forward`` instead of its policy."""
    policy = FakePolicySpec(ForwardPolicy(enough=2.0), request.policy.wrappers)
    return PlaceActivity(replace(request, policy=policy), endpoint, make_env=FlatEnvironment)  # type: ignore[arg-type]
