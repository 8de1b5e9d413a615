"""A dynamic movement primitive: a spring that ends at a goal, bent on its way by a force that was learned.

Pastor, Hoffmann, Asfour and Schaal 2009 (equations 6 to 8), a form of Ijspeert's primitives whose force is not scaled
by the distance to the goal, so that an axis that ends where it began can move in between. With u = t / duration, for
each axis, x0 where it starts and g where it ends:

    x'' = K (g - x) - D x' - K (g - x0) s + K f(s)        D = 2 sqrt(K): critically damped
    s'  = -a s,  s(0) = 1
    f(s) = s sum psi_i(s) w_i / sum psi_i(s)              psi_i(s) = exp(-h_i (s - c_i)^2)

The force dies out with s: whatever was learned, the axis comes to rest at the goal. Nothing of the cloth enters.
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
    """One primitive for each of the A axes that the holder can move along."""

    FORMAT: ClassVar[str] = "layflat-dmp"
    ARRAYS: ClassVar[tuple[str, ...]] = ("goal", "weights")
    SETTINGS: ClassVar[Mapping[str, type]] = {"duration_s": float}

    goal: FloatArray
    """(A,) m, world: where the demonstrations end, on average."""
    weights: FloatArray
    """(A, B) m: w_i."""
    duration_s: float
    """How long the demonstrations take, on average; simulated time."""

    def __post_init__(self) -> None:
        outputs = self.layout.robot.size
        freeze(self, "goal", (outputs,))
        freeze(self, "weights", (outputs, None))
        if self.layout != input_set(self.layout.robot, "position"):
            raise PolicyError(f"a primitive sees the position only, not {', '.join(self.layout.names)}")
        if self.weights.shape[1] < 2:
            raise PolicyError(f"weights have shape {self.weights.shape}; at least 2 basis functions are needed")
        self._above_zero("duration_s")
        super().__post_init__()

    @property
    def points(self) -> int:
        return self.weights.shape[1]

    @property
    def made_of(self) -> str:
        return "basis functions for each axis"

    @property
    def step_u(self) -> float:
        """What a step is of the duration."""
        return self.step_s / self.duration_s


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Where all axes are at u, and how fast; (A,) m and m per unit of u."""

    u: float
    position: FloatArray
    speed: FloatArray


def at_rest(position: FloatArray) -> Motion:
    """At the beginning."""
    return Motion(u=0.0, position=position, speed=np.zeros_like(position))


def advanced(motion: Motion, step_u: float, start: FloatArray, goal: FloatArray, weights: FloatArray) -> Motion:
    """One step of the classical Runge-Kutta method: with 50 or more for u = 0..1 it errs by at most 1e-5 of the way."""

    def slope(u: float, position: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        s = np.exp(-PHASE_RATE * u)
        force = weights @ features(s, weights.shape[1])
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


def path(start: FloatArray, goal: FloatArray, weights: FloatArray, *, step_u: float, steps: int) -> FloatArray:
    """(steps + 1, A) m from rest at ``start``, which is its first row."""
    motions = [at_rest(start)]
    for _ in range(steps):
        motions.append(advanced(motions[-1], step_u, start, goal, weights))
    return np.array([motion.position for motion in motions])


def features(s: float, count: int) -> FloatArray:
    """(B,) s psi_i(s) / sum psi: centres evenly spaced in u = 0..1, each as wide as the gap to the next."""
    centres = np.exp(-PHASE_RATE * np.linspace(0.0, 1.0, count))
    gaps = -np.diff(centres)
    exponents = -(((s - centres) / np.append(gaps, gaps[-1])) ** 2)
    # Relative to the largest: after the last centre all of them may underflow.
    psi = np.exp(exponents - exponents.max())
    return s * psi / psi.sum()
