"""An environment of a few numbers instead of physics: actions have consequences, and a step takes microseconds."""

from __future__ import annotations

from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import DisturbanceRecord, GroundTruth, Observation
from layflat.policy.base import Decision
from layflat.policy.environment import Environment
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import robot_spec

ACTING_STEPS = 4
"""Steps that a fake disturbance acts, settling included."""


class FakeEnvironment(Environment):
    """The cloth is as flat as the robot is far forward; drags and disturbances wrinkle it for good."""

    spec = None  # An attribute in place of the protocol's property.

    def __init__(self, config: SimConfig) -> None:
        self.config = config
        self.spec = config.environment_spec()
        self.diverges_at: int | None = None
        """Step at which the cloth diverges."""

    def reset(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.seed, self.n_steps, self.wrinkles = seed, 0, 0.0
        self.holder_m = rng.uniform(0, 0.01, 3)
        self.nodes = rng.uniform(0, 0.1, (6, 3))
        self.push, self.push_steps_left = np.zeros(3), 0
        self._force_n = np.zeros(3)
        self._drag: tuple[int, FloatArray] | None = None

    def close(self) -> None: ...

    @property
    def contact(self) -> float:
        return float(np.clip(self.holder_m[0] / 0.4 - self.wrinkles, 0.0, 1.0))

    def observe(self) -> Observation:
        half = np.array([0.0, 0.15, 0.0])
        return Observation(
            time_s=self.n_steps * self.spec.step_s,
            corner_positions=[self.holder_m + half, self.holder_m - half],
            holder_position=self.holder_m,
            word=[1.0, 0.0],
            word_strength=0.1,
            contact_portion=self.contact,
            rgb=np.zeros((2, 2, 3), np.uint8),
        )

    def ground_truth(self) -> GroundTruth:
        return GroundTruth(nodes=self.nodes, contact_portion_true=self.contact, flat_area=self.contact)

    def divergence_reason(self) -> str | None:
        return "diverged" if self.n_steps == self.diverges_at else None

    @property
    def disturbed(self) -> bool:
        return self.push_steps_left > 0

    def disturb(self, disturbance: Any, repeat: int = 0) -> DisturbanceRecord:
        plan = dict(disturbance.plan) if isinstance(disturbance, DisturbanceRecord) else {}
        if not plan:
            plan = {"push": np.random.default_rng([self.seed, repeat]).normal(size=3).tolist()}
        self.push, self.push_steps_left = np.array(plan["push"]), ACTING_STEPS
        return DisturbanceRecord(name=str(getattr(disturbance, "name", disturbance)), first_step=0, plan=plan)

    def force_n(self) -> FloatArray:
        return self._force_n

    def drag(self, node: int, target_m: FloatArray) -> None:
        self._drag = node, np.array(target_m)

    def release(self) -> None:
        self._drag = None

    def guide(self, hand_m: FloatArray | None) -> FloatArray:
        """Give way by half of the distance, independent of the action before."""
        action = self.spec.robot.pack(np.clip(0.5 * (np.atleast_2d(hand_m) - self.holder_m), -0.02, 0.02))
        self.wrinkles += 0.001  # A compliant arm trembles: the same displacement by command is not the same.
        self.step(action)
        return action

    def step(self, action: FloatArray) -> None:
        self.n_steps += 1
        self._force_n = np.zeros(3)
        move = self.spec.robot.unpack(action).mean(axis=0)
        self.holder_m = self.holder_m + move
        self.nodes = np.sin(self.nodes + move)
        if self._drag is not None:
            node, target = self._drag
            self._force_n = self._force_n + target - self.nodes[node]
            self.nodes[node] += 0.3 * (target - self.nodes[node])
            self.wrinkles += 0.01
        if self.disturbed:
            self._force_n = self._force_n + self.push
            self.nodes = self.nodes + 0.01 * self.push
            self.wrinkles += 0.02
            self.push_steps_left -= 1
        if self.n_steps == self.diverges_at:
            self.nodes, self._force_n = self.nodes * np.nan, self._force_n * np.nan


class ForwardPolicy:
    """Moves on until the contact portion is ``enough``; after a disturbance, until it is so again."""

    name = "forward"

    def __init__(self, enough: float = 0.5) -> None:
        self.robot = robot_spec("hanger")
        self.enough = enough
        self.continued = 0
        """Number of disturbances after which it was continued."""

    def reset(self, seed: int) -> None:
        self.continued = 0

    def continue_after_disturbance(self) -> None:
        self.continued += 1

    def act(self, observation: Observation) -> Decision:
        stop = "converged" if observation.contact_portion >= self.enough else None
        return Decision(action=[0.01, -0.001], std=[0.001, 0.002], stop=stop)


class DownPolicy:
    """Moves straight down, 1 cm a step, for the wrappers around it."""

    name = "down"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot

    def reset(self, seed: int) -> None: ...

    def act(self, observation: Observation) -> Decision:
        return Decision(action=self.robot.pack([0.0, 0.0, -0.01]), reason="down")
