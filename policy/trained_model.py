"""What every trained model says of itself, whichever method it belongs to: the part of a model file that all share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.types import ACTION_LIMIT_M, STEP_S, Provenance
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, DESCRIPTORS
from layflat.policy.base import PolicyError
from layflat.policy.features import FeatureLayout

STOP_THRESHOLD_M = 0.003
STOP_STEPS = 8
"""Norm of the output below which, and steps for which, a policy has finished (chapter 4-2-3 gives no number)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedModel:
    """Base of the trained models; immutable, arrays read-only.

    A method adds its arrays as fields and says how they are kept: ``arrays`` and ``settings`` are what its file holds
    beside the shared header, ``restored`` makes the model of them again.
    """

    FORMAT: ClassVar[str]
    """What the header of its files says."""
    ARRAYS: ClassVar[tuple[str, ...]]
    """Arrays that each file has."""
    OPTIONAL: ClassVar[tuple[str, ...]] = ()
    """Arrays that a file may have."""
    SETTINGS: ClassVar[Mapping[str, type]] = {}
    """Header fields of this method alone."""

    policy: str
    """Name of the policy that it makes, as in the registry."""
    layout: FeatureLayout
    cloth: str
    """Cloth of the demonstrations."""
    descriptor: str = DEFAULT_DESCRIPTOR
    """What the observations' WORD was and is to be taken from."""
    step_s: float = STEP_S
    action_limit_m: float = ACTION_LIMIT_M
    stop_threshold_m: float = STOP_THRESHOLD_M
    stop_steps: int = STOP_STEPS
    seed: int = 0
    demonstrations: int = 1
    points_available: int = 0
    """Steps of the demonstrations before any thinning."""
    heldout_rmse_m: tuple[float, ...] | None = None
    """(A,) m per step, error on a demonstration by a model without it; None where there was only one."""
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        for name in ("step_s", "stop_threshold_m", "stop_steps", "demonstrations"):
            self._above_zero(name)
        if not 0 < self.action_limit_m <= ACTION_LIMIT_M:
            raise PolicyError(f"action_limit_m is {self.action_limit_m}; it must be in 0..{ACTION_LIMIT_M}")
        if not (self.policy and self.cloth):
            raise PolicyError("a model must name its policy and its cloth")
        if self.descriptor not in DESCRIPTORS:
            raise PolicyError(f"descriptor is {self.descriptor!r}; it must be one of {', '.join(DESCRIPTORS)}")
        if self.heldout_rmse_m is not None:
            outputs = self.layout.robot.size
            object.__setattr__(self, "heldout_rmse_m", tuple(float(v) for v in self.heldout_rmse_m))
            if len(self.heldout_rmse_m) != outputs:
                raise PolicyError(f"heldout_rmse_m has {len(self.heldout_rmse_m)} values; it must have {outputs}")

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the A outputs."""
        return self.layout.robot.action_names

    @property
    def points(self) -> int:
        """Number of parts that the model is made of: steps, components or basis functions."""
        raise NotImplementedError

    @property
    def made_of(self) -> str:
        """What ``points`` counts, for a person."""
        return "points"

    def arrays(self) -> dict[str, FloatArray]:
        """What its file holds, by name."""
        return {name: getattr(self, name) for name in self.ARRAYS}

    def settings(self) -> dict[str, Any]:
        """Header fields of this method alone."""
        return {name: kind(getattr(self, name)) for name, kind in self.SETTINGS.items()}

    @classmethod
    def restored(
        cls, shared: Mapping[str, Any], arrays: Mapping[str, Any], settings: Mapping[str, Any]
    ) -> TrainedModel:
        """The model whose shared fields, ``arrays`` and ``settings`` these are."""
        return cls(**shared, **arrays, **settings)

    def _above_zero(self, name: str) -> None:
        value = getattr(self, name)
        if not (np.isfinite(value) and value > 0):
            raise PolicyError(f"{name} is {value}; it must be above 0")


class RegressionModel(TrainedModel):
    """A model whose action is a function of what is seen now: a field over its inputs."""

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (M, A) each, in m per step, for (M, D) inputs in natural units."""
        raise NotImplementedError

    def _queries(self, inputs: ArrayLike) -> FloatArray:
        """``inputs`` as an (M, D) array, or a PolicyError."""
        queries = np.asarray(inputs, dtype=np.float64)
        if queries.ndim != 2 or queries.shape[1] != self.layout.size:
            raise PolicyError(f"inputs have shape {queries.shape}; they must be (M, {self.layout.size})")
        return queries


def freeze(instance: object, name: str, shape: tuple[int | None, ...]) -> None:
    """Replace an array field of a frozen dataclass by a checked, read-only copy."""
    try:
        object.__setattr__(instance, name, frozen_array(getattr(instance, name), shape, name))
    except ValueError as error:
        raise PolicyError(str(error)) from error
