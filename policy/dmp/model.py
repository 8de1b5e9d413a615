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

from collections.abc import Mapping
from dataclasses import dataclass
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


@dataclass(frozen=True, kw_only=True)
class Motion:
    """State of all axes at u: position (A,) m and speed (A,) m per unit of u."""

    u: float
    position: FloatArray
    speed: FloatArray


def at_rest(position: FloatArray) -> Motion:
    """Return the state at the start, u = 0."""
    return Motion(u=0.0, position=position, speed=np.zeros_like(position))


def advance(motion: Motion, step_u: float, start: FloatArray, goal: FloatArray, weights: FloatArray) -> Motion:
    """Integrate one step with the classical Runge-Kutta method.

    With 50 or more steps for u = 0..1 its error is at most 1e-5 of the way.
    """

    def slope(u: float, position: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        s = np.exp(-PHASE_RATE * u)
        force = weights @ basis(s, weights.shape[1])
        pull = STIFFNESS * (goal - position - (goal - start) * s + force)
        return speed, pull - DAMPING * speed

    h, x, v = step_u, motion.position, motion.speed
    x1, v1 = slope(motion.u, x, v)
    x2, v2 = slope(motion.u + h / 2, x + h / 2 * x1, v + h / 2 * v1)
    x3, v3 = slope(motion.u + h / 2, x + h / 2 * x2, v + h / 2 * v2)
    x4, v4 = slope(motion.u + h, x + h * x3, v + h * v3)
    return Motion(
        u=motion.u + h,
        position=x + h / 6 * (x1 + 2 * x2 + 2 * x3 + x4),
        speed=v + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4),
    )


def path(start: FloatArray, goal: FloatArray, weights: FloatArray, *, step_u: float, n_steps: int) -> FloatArray:
    """Return positions (n_steps + 1, A) m from rest at ``start``, which is the first row."""
    motions = [at_rest(start)]
    for _ in range(n_steps):
        motions.append(advance(motions[-1], step_u, start, goal, weights))
    return np.array([motion.position for motion in motions])


def basis(s: float, count: int) -> FloatArray:
    """Return (B,) s psi_i(s) / sum psi: centres evenly spaced in u = 0..1, each as wide as the gap to the next."""
    centres = np.exp(-PHASE_RATE * np.linspace(0.0, 1.0, count))
    gaps = -np.diff(centres)
    exponents = -(((s - centres) / np.append(gaps, gaps[-1])) ** 2)
    # Relative to the largest, because all of them may underflow after the last centre.
    psi = np.exp(exponents - exponents.max())
    return s * psi / psi.sum()
