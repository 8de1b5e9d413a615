"""A bench of a few numbers instead of physics: what is done to it has consequences, and it steps in microseconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import FLAT_AREA, DisturbanceRecord, DragTarget, GroundTruth, Observation
from layflat.policy.base import Decision
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DisturbanceSpec, DisturbanceTrajectory, disturbance_spec
from layflat.sim.errors import SimError

ACTING_STEPS = 4
"""A fake disturbance acts so long, settling included."""


@dataclass
class FakeDisturbance:
    plan: DisturbanceTrajectory
    left: int = ACTING_STEPS


class FakeBench:
    """The cloth is as flat as the holder is far forward; pulls and disturbances wrinkle it, for good."""

    cloth_state = None

    def __init__(self, settings: SimConfig) -> None:
        self.config = settings
        self.spec = settings.environment_spec()
        self.start: dict[str, float] = {}
        self.breaks_at: int | None = None
        """Step at which the cloth diverges."""

    def reset(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._seed = seed
        self._holder_m = rng.uniform(0, 0.01, 3)
        self._nodes = rng.uniform(0, 0.1, (6, 3))
        self._wrinkles = 0.0
        self._n_steps = 0
        self._force_n = np.zeros(3)
        self._pull: tuple[int, FloatArray] | None = None
        self.disturbance: FakeDisturbance | None = None

    def joint_angles(self) -> FloatArray:
        return np.zeros(7)

    def observe(self, *, images: bool = True) -> Observation:
        half = np.array([0.0, 0.15, 0.0])
        return Observation(
            time_s=self._n_steps * self.spec.step_s,
            corner_positions=[self._holder_m + half, self._holder_m - half],
            holder_position=self._holder_m,
            word=[1.0, 0.0],
            word_strength=0.1,
            contact_portion=self._contact(),
            rgb=np.zeros((2, 2, 3), np.uint8) if images else None,
        )

    def _contact(self) -> float:
        return float(np.clip(self._holder_m[0] / 0.4 - self._wrinkles, 0.0, 1.0))

    def ground_truth(self) -> GroundTruth:
        return GroundTruth(nodes=self._nodes, contact_portion_true=self._contact(), flat_area=self._contact())

    def success(self) -> bool:
        return self._contact() > FLAT_AREA

    def divergence_reason(self) -> str | None:
        return "diverged" if self._n_steps == self.breaks_at else None

    @property
    def disturbed(self) -> bool:
        return self.disturbance is not None

    def disturb(
        self, disturbance: str | DisturbanceSpec | DisturbanceRecord, repeat: int = 0
    ) -> DisturbanceRecord | None:
        name = disturbance if isinstance(disturbance, str) else disturbance.name
        if isinstance(disturbance, DisturbanceRecord) and disturbance.plan:
            plan = DisturbanceTrajectory.recorded(disturbance.plan, self.config.cloth_spec)
        else:
            spec = disturbance if isinstance(disturbance, DisturbanceSpec) else disturbance_spec(name)
            plan = spec.sample(np.random.default_rng([self._seed, repeat]), self.config.cloth_spec)
        self.disturbance = FakeDisturbance(plan)
        return DisturbanceRecord(name=name, first_step=0, plan=plan.described())

    def drag(self, node: int, target_m: FloatArray) -> None:
        if not 0 <= node < len(self._nodes):
            raise SimError(f"no node {node}")
        self._pull = node, np.array(target_m)

    def release(self) -> None:
        self._pull = None

    @property
    def drag_target(self) -> DragTarget | None:
        return None if self._pull is None else DragTarget(node=self._pull[0], target_m=self._pull[1])

    def hand_positions(self) -> FloatArray:
        return np.zeros((0, 3))

    def close(self) -> None: ...

    def force_n(self) -> FloatArray:
        return self._force_n.copy()

    def step(self, action: FloatArray) -> None:
        self._advance(np.asarray(action, dtype=float))

    def guide(self, hand_m: FloatArray) -> FloatArray:
        """The holder gives way by half of what is missing, whatever it was told before."""
        missing = np.atleast_2d(hand_m) - self._holder_m
        planar = missing[0, [0, 2]] if self.spec.robot.n_points == 1 else np.resize(missing, 6)
        action = np.clip(0.5 * planar, -0.02, 0.02)
        self._wrinkles += 0.001  # A compliant arm trembles: the same displacement by command is not the same.
        self._advance(action)
        return action

    def _advance(self, action: FloatArray) -> None:
        assert action.shape == (self.spec.robot.size,)
        self._n_steps += 1
        self._force_n = np.zeros(3)
        move = np.array([action[0], 0.0, action[1]]) if action.size == 2 else action.reshape(2, 3).mean(axis=0)
        self._holder_m = self._holder_m + move
        self._nodes = np.sin(self._nodes + move)
        if self._pull is not None:
            node, target = self._pull
            self._force_n = self._force_n + (target - self._nodes[node])
            self._nodes[node] += 0.3 * (target - self._nodes[node])
            self._wrinkles += 0.01
        if self.disturbance is not None:
            push = np.asarray(self.disturbance.plan.path_m[-1]) + np.asarray(self.disturbance.plan.wind_m_s2)
            self._force_n = self._force_n + push
            self._nodes = self._nodes + 0.01 * push
            self._wrinkles += 0.02
            self.disturbance.left -= 1
            if self.disturbance.left == 0:
                self.disturbance = None
        if self._n_steps == self.breaks_at:
            self._nodes, self._force_n = self._nodes * np.nan, self._force_n * np.nan


class Forward:
    """Moves on until the contact portion is ``enough``; after a disturbance, until it is so again."""

    name = "forward"
    robot = "hanger"

    def __init__(self, enough: float = 0.5) -> None:
        self.enough = enough
        self.resumed = 0

    def reset(self, seed: int) -> None:
        self.resumed = 0

    def continue_after_disturbance(self) -> None:
        self.resumed += 1

    def act(self, observation: Observation) -> Decision:
        stop = "converged" if observation.contact_portion >= self.enough else None
        return Decision(action=[0.01, -0.001], std=[0.001, 0.002], stop=stop)
