"""DmpModel: a dynamic movement primitive, a spring that ends at a goal, bent on its way by a learned force.

Pastor, Hoffmann, Asfour and Schaal 2009 (equations 6 to 8), a form of Ijspeert's primitives whose force is not scaled
by the distance to the goal, so that an axis that ends where it began can move in between. With u = t / duration, for
each axis, x0 where it starts and g where it ends:

    x'' = K (g - x) - D x' - K (g - x0) s + K f(s)        D = 2 sqrt(K): critically damped
    s'  = -a s,  s(0) = 1
    f(s) = s sum psi_i(s) w_i / sum psi_i(s)              psi_i(s) = exp(-h_i (s - c_i)^2)

The force vanishes with s, so that every axis comes to rest at its goal. No input describes the cloth.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.policy.base import PolicyError
from layflat.policy.features import input_set
from layflat.policy.trained_model import TrainedModel, freeze

STIFFNESS = 156.25
"""K for u = t / duration: 25 * 25 / 4, the usual gains; the spring alone has covered 99 % of its way at u = 0.53."""
DAMPING = 2 * STIFFNESS**0.5
PHASE_RATE = 4.0
"""a: s has fallen to 2 % when the demonstrations end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DmpModel(TrainedModel):
    """One primitive of B basis functions for each of the robot's A action axes."""

    FORMAT: ClassVar[str] = "layflat-dmp"
    ARRAYS: ClassVar[tuple[str, ...]] = ("goal", "weights")
    SETTINGS: ClassVar[Mapping[str, type]] = {"duration_s": float}

    goal: FloatArray
    """(A,) m, world: mean end of the demonstrations."""
    weights: FloatArray
    """(A, B) m: w_i."""
    duration_s: float
    """Mean duration of the demonstrations, s of simulated time."""

    def __post_init__(self) -> None:
        freeze(self, "goal", (len(self.outputs),))
        freeze(self, "weights", (len(self.outputs), None))
        if self.layout != input_set(self.layout.robot, "position"):
            raise PolicyError(f"a primitive sees the position only, not {', '.join(self.layout.names)}")
        if self.weights.shape[1] < 2:
            raise PolicyError(f"weights have shape {self.weights.shape}; at least 2 basis functions are needed")
        self._require_positive("duration_s")
        super().__post_init__()

    @property
    def n_points(self) -> int:
        """Number of basis functions for each axis."""
        return self.weights.shape[1]

    @property
    def point_name(self) -> str:
        """Name of the parts that ``n_points`` counts."""
        return "basis functions for each axis"

    @property
    def step_u(self) -> float:
        """Duration of a step as a share of the primitive's duration."""
        return self.step_s / self.duration_s


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
