"""Dynamic movement primitive: a spring that ends at a goal, bent on its way by a learned force.

Pastor, Hoffmann, Asfour and Schaal 2009 (equations 6 to 8), a form of Ijspeert's primitives whose force is not scaled
by the distance to the goal, so that an axis that ends where it began can move in between. With u = t / duration, for
each axis, x0 where it starts and g where it ends:

    x'' = K (g - x) - D x' - K (g - x0) s + K f(s)        D = 2 sqrt(K): critically damped
    s'  = -a s,  s(0) = 1
    f(s) = s sum psi_i(s) w_i / sum psi_i(s)              psi_i(s) = exp(-h_i (s - c_i)^2)

The force vanishes with s, so that every axis comes to rest at its goal. No input describes the cloth.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Observation
from layflat.policy.base import Decision, PolicyError
from layflat.policy.features import FeatureLayout, input_set
from layflat.policy.model_policy import model_stop_rule
from layflat.policy.stopping import RuleStoppedPolicy, StopRule
from layflat.policy.trained_model import Progress, TrainedModel, freeze, ignore_progress
from layflat.policy.training_set import Demonstrations, TrainingSet, rmse

STIFFNESS = 156.25
"""K for u = t / duration: 25 * 25 / 4, the usual gains; the spring alone has covered 99 % of its way at u = 0.53."""
DAMPING = 2 * STIFFNESS**0.5
PHASE_RATE = 4.0
"""a: s has fallen to 2 % when the demonstrations end."""
BASIS = 25
"""Number of basis functions for each axis."""
RIDGE = 1e-6
"""Keeps the weights of basis functions without much effect small; relative to their mean square response."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DmpModel(TrainedModel):
    """One primitive of B basis functions for each of the robot's A action axes."""

    FORMAT = "layflat-dmp"
    ARRAYS = ("goal", "weights")
    SETTINGS: ClassVar[Mapping[str, type]] = {"duration_s": float}
    POINT_NAME = "basis functions for each axis"

    goal: FloatArray
    """(A,) m, world: mean end of the demonstrations."""
    weights: FloatArray
    """(A, B) m: w_i."""
    duration_s: float
    """Mean duration of the demonstrations, s of simulated time."""

    def __post_init__(self) -> None:
        freeze(self, "goal", (len(self.outputs),))
        freeze(self, "weights", (len(self.outputs), None))
        if self.layout.names != input_set(self.layout.robot, "position").names:
            raise PolicyError(f"a primitive sees the position only, not {', '.join(self.layout.names)}")
        if self.weights.shape[1] < 2:
            raise PolicyError(f"weights have shape {self.weights.shape}; at least 2 basis functions are needed")
        self._require_positive("duration_s")
        super().__post_init__()

    @property
    def n_points(self) -> int:
        """Number of basis functions for each axis."""
        return self.weights.shape[1]


class DmpPolicy(RuleStoppedPolicy):
    """Follows the primitive from the robot's first position to the goal and rests there; it does not see the cloth.

    The actions are the primitive's own steps, so that the robot's lag does not add up. After a disturbance the
    primitive continues; it does not start again.
    """

    def __init__(self, model: DmpModel, *, guard: StopRule | None = None) -> None:
        super().__init__(model.policy, model.layout.robot, model_stop_rule(model, guard))
        self.model = model
        self._trajectory: Iterator[tuple[float, FloatArray]] | None = None

    def reset(self, seed: int) -> None:
        """Start a new episode."""
        super().reset(seed)
        self._trajectory = None

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        model, limit = self.model, self.model.action_limit_m
        if self._trajectory is None:
            self._commanded = model.layout.vector(observation)
            step_u = model.step_s / model.duration_s
            self._trajectory = trajectory(self._commanded, model.goal, model.weights, step_u)
        u, position = next(self._trajectory)
        # Later steps make up for what the limit cuts off.
        action = np.clip(position - self._commanded, -limit, limit)
        decision = self._decide(observation, action, f"{100 * min(u, 1.0):.0f} % of the way")
        if decision.stop is None:
            self._commanded = self._commanded + action
        return decision


def trajectory(
    start: FloatArray, goal: FloatArray, weights: FloatArray, step_u: float
) -> Iterator[tuple[float, FloatArray]]:
    """Yield u and the position (A,) m after each step, without end, from rest at ``start``.

    The classical Runge-Kutta method: with 50 or more steps for u = 0..1 its error is at most 1e-5 of the way.
    """

    def slope(u: float, state: FloatArray) -> FloatArray:
        position, speed = state
        s = np.exp(-PHASE_RATE * u)
        force = weights @ basis(s, weights.shape[1])
        pull = STIFFNESS * (goal - position - (goal - start) * s + force)
        return np.array([speed, pull - DAMPING * speed])

    u, h, state = 0.0, step_u, np.array([start, np.zeros_like(start)])
    while True:
        k1 = slope(u, state)
        k2 = slope(u + h / 2, state + h / 2 * k1)
        k3 = slope(u + h / 2, state + h / 2 * k2)
        k4 = slope(u + h, state + h * k3)
        u, state = u + h, state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        yield u, state[0]


def path(start: FloatArray, goal: FloatArray, weights: FloatArray, *, step_u: float, n_steps: int) -> FloatArray:
    """Return positions (n_steps + 1, A) m from rest at ``start``, which is the first row."""
    moves = islice(trajectory(start, goal, weights, step_u), n_steps)
    return np.array([start, *(position for _, position in moves)])


def basis(s: float, count: int) -> FloatArray:
    """Return (B,) s psi_i(s) / sum psi: centres evenly spaced in u = 0..1, each as wide as the gap to the next."""
    centres = np.exp(-PHASE_RATE * np.linspace(0.0, 1.0, count))
    gaps = -np.diff(centres)
    exponents = -(((s - centres) / np.append(gaps, gaps[-1])) ** 2)
    # Relative to the largest, because all of them may underflow after the last centre.
    psi = np.exp(exponents - exponents.max())
    return s * psi / psi.sum()


def fit(training: TrainingSet, progress: Progress = ignore_progress) -> DmpModel:
    """Fit a model to the placing phase; what follows a disturbance is left out.

    Each demonstration has its own start, end and duration; the weights are common to all. Positions are linear in the
    weights, which therefore follow from least squares on positions, without second derivatives.
    """
    source, step_s = training.demonstrations, training.demonstrations.step_s
    paths = [_demonstrated_path(source, number, training.layout) for number in range(len(source))]
    goal, weights, duration_s = _fit_paths(paths, step_s)
    progress(1, 1, f"{len(paths)} paths of {duration_s:.1f} s on average")
    held_out = _held_out_rmse(source, paths)
    return DmpModel(**training.shared(), goal=goal, weights=weights, duration_s=duration_s, heldout_rmse_m=held_out)


def _demonstrated_path(source: Demonstrations, number: int, layout: FeatureLayout) -> FloatArray:
    """Return the coordinates (T + 1, A) m before each step of placing and after the last."""
    own = np.flatnonzero(source.numbers == number)
    placed = own[source.phases[own] == b"place"]
    if len(placed) < 2:
        seed = source.seeds[number]
        raise PolicyError(f"the demonstration of seed {seed} holds {len(placed)} steps of placing; 2 are needed")
    before, after = layout.select(source.observations), layout.select(source.next_positions)
    return np.vstack([before[placed], after[own[len(placed) - 1]]])


def _fit_paths(paths: Sequence[FloatArray], step_s: float) -> tuple[FloatArray, FloatArray, float]:
    """Return the goal, weights and duration of a primitive for these paths."""
    axes, zeros = paths[0].shape[1], np.zeros(BASIS)
    responses, rests = [], []
    for way in paths:
        n_steps = len(way) - 1
        # Response of an axis at rest to each basis function alone.
        responses.append(path(zeros, zeros, np.eye(BASIS), step_u=1 / n_steps, n_steps=n_steps))
        spring = path(way[0], way[-1], np.zeros((axes, BASIS)), step_u=1 / n_steps, n_steps=n_steps)
        rests.append(way - spring)
    response, rest = np.vstack(responses), np.vstack(rests)
    gram = response.T @ response
    gram[np.diag_indices(BASIS)] += RIDGE * np.trace(gram) / BASIS
    # In row order, as a file restores it: sums over a transposed array differ in the last bit.
    weights: FloatArray = np.ascontiguousarray(np.linalg.solve(gram, response.T @ rest).T)
    goal = np.mean([way[-1] for way in paths], axis=0)
    return goal, weights, step_s * float(np.mean([len(way) - 1 for way in paths]))


def _held_out_rmse(source: Demonstrations, paths: Sequence[FloatArray]) -> tuple[float, ...] | None:
    """Return (A,) m per step: error of the moves from each demonstration's start, learned from other recordings."""
    if len(set(source.recordings)) < 2:
        return None
    errors = []
    for k, way in enumerate(paths):
        others = [
            other
            for other, recording in zip(paths, source.recordings, strict=True)
            if recording != source.recordings[k]
        ]
        goal, weights, duration_s = _fit_paths(others, source.step_s)
        n_steps = len(way) - 1
        moves = np.diff(path(way[0], goal, weights, step_u=source.step_s / duration_s, n_steps=n_steps), axis=0)
        errors.append(source.actions[source.numbers == k][:n_steps] - moves)
    return rmse(np.vstack(errors))
