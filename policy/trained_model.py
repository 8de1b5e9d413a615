"""TrainedModel: the fields that all trained models share, and the interface of the methods that predict actions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, TypeAlias

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

Progress: TypeAlias = Callable[[int, int, str], None]
"""Called by a fit with the number of finished parts, the number of all parts, and a message about the last one."""


def ignore_progress(done: int, total: int, message: str) -> None:
    """Do nothing: the default of a fit's ``progress``."""


class TaughtCloth(NamedTuple):
    """A cloth of the demonstrations."""

    name: str
    length_m: float
    width_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedModel:
    """Base of the trained models; immutable, arrays read-only.

    A method adds its arrays and settings as fields and names them in the class variables, with which
    `layflat.policy.model_io` stores them.
    """

    FORMAT: ClassVar[str]
    """Name of the method in the header of its files."""
    ARRAYS: ClassVar[tuple[str, ...]]
    """Arrays that each file has."""
    OPTIONAL: ClassVar[tuple[str, ...]] = ()
    """Arrays that a file may have."""
    SETTINGS: ClassVar[Mapping[str, type]] = {}
    """Header fields of this method alone."""
    POINTS: ClassVar[str] = "inputs"
    """Array with a row for each part that the model consists of."""
    POINT_NAME: ClassVar[str] = "points"
    """Name of these parts, in the plural."""

    policy: str
    """Name of the policy that runs the model, as in `layflat.policy.registry.LEARNERS`."""
    layout: FeatureLayout
    """Robot, and features that the model takes as input."""
    cloth: str
    """Cloth that it was taught on, the first of ``cloths``."""
    cloths: tuple[TaughtCloth, ...] = ()
    """All of them, as far as their sizes are known."""
    task: str = "place"
    descriptor: str = DEFAULT_DESCRIPTOR
    """Source of the observations' WORD."""
    step_s: float = STEP_S
    action_limit_m: float = ACTION_LIMIT_M
    """Largest component of an action, m per step."""
    stop_threshold_m: float = STOP_THRESHOLD_M
    stop_steps: int = STOP_STEPS
    seed: int = 0
    demonstrations: int = 1
    """Number of demonstrations; ``points_available`` is that of their steps."""
    points_available: int = 0
    taught: tuple[tuple[str, int], ...] = ()
    """Start and seed of each demonstration; an evaluation of the same robot, task and cloth leaves them out."""
    heldout_rmse_m: tuple[float, ...] | None = None
    """Error on a demonstration by a model trained without it, m per step for each output; None for a single one."""
    provenance: Provenance = field(default_factory=Provenance)
    """Versions and command of the training."""

    def __post_init__(self) -> None:
        if not self.n_points:
            raise PolicyError("a model needs at least one point")
        self._require_positive("step_s", "stop_threshold_m", "stop_steps", "demonstrations")
        if not 0 < self.action_limit_m <= ACTION_LIMIT_M:
            raise PolicyError(f"action_limit_m is {self.action_limit_m}; it must be in 0..{ACTION_LIMIT_M}")
        if not (self.policy and self.cloth and self.task):
            raise PolicyError("a model must name its policy, its cloth and its task")
        if self.descriptor not in DESCRIPTORS:
            raise PolicyError(f"descriptor is {self.descriptor!r}; it must be one of {', '.join(DESCRIPTORS)}")
        object.__setattr__(self, "cloths", tuple(taught_cloth(*cloth) for cloth in self.cloths))
        object.__setattr__(self, "taught", tuple((str(start), int(seed)) for start, seed in self.taught))
        if self.heldout_rmse_m is not None:
            object.__setattr__(self, "heldout_rmse_m", tuple(float(v) for v in self.heldout_rmse_m))
            if len(self.heldout_rmse_m) != len(self.outputs):
                raise PolicyError(f"heldout_rmse_m has {len(self.heldout_rmse_m)} values, not {len(self.outputs)}")

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the A outputs."""
        return self.layout.robot.action_names

    @property
    def n_points(self) -> int:
        """Number of parts that the model consists of: points, components or basis functions."""
        return len(getattr(self, self.POINTS))

    @property
    def point_name(self) -> str:
        """Name, in the plural, of the parts that ``n_points`` counts."""
        return self.POINT_NAME

    def arrays(self) -> dict[str, FloatArray]:
        """Return the arrays for a file, by name."""
        return {name: getattr(self, name) for name in self.ARRAYS}

    def settings(self) -> dict[str, Any]:
        """Return the header fields of this method alone."""
        return {name: kind(getattr(self, name)) for name, kind in self.SETTINGS.items()}

    @classmethod
    def from_arrays(
        cls, shared: Mapping[str, Any], arrays: Mapping[str, Any], settings: Mapping[str, Any]
    ) -> TrainedModel:
        """Make a model from its shared fields and what `arrays` and `settings` returned."""
        return cls(**shared, **arrays, **settings)

    def _require_positive(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if not (np.isfinite(value) & (np.asarray(value) > 0)).all():
                raise PolicyError(f"{name} is {np.min(value)}; it must be above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class RegressionModel(TrainedModel):
    """A trained model whose action is a function of the current observation."""

    input_scale: FloatArray
    """(D,) divisor of each input column."""

    def __post_init__(self) -> None:
        freeze(self, "input_scale", (self.layout.size,))
        self._require_positive("input_scale")
        super().__post_init__()

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of the action, (M, A) m per step, for inputs (M, D) in natural units."""
        raise NotImplementedError

    def _scaled(self, inputs: ArrayLike) -> FloatArray:
        """Return ``inputs`` (M, D) in scaled units; PolicyError if the shape is wrong."""
        queries = np.asarray(inputs, dtype=np.float64)
        if queries.ndim != 2 or queries.shape[1] != self.layout.size:
            raise PolicyError(f"inputs have shape {queries.shape}; they must be (M, {self.layout.size})")
        return queries / self.input_scale


def taught_cloth(name: Any, length_m: Any, width_m: Any) -> TaughtCloth:
    """Return a checked cloth; PolicyError for a size that no cloth has."""
    sizes = float(length_m), float(width_m)
    if not all(0.01 < size < 10.0 for size in sizes):
        raise PolicyError(f"cloth {name} is {length_m} x {width_m} m; it must be 0.01 to 10")
    return TaughtCloth(str(name), *sizes)


def freeze(instance: object, name: str, shape: tuple[int | None, ...]) -> None:
    """Replace an array field of a frozen dataclass by a checked, read-only copy."""
    try:
        object.__setattr__(instance, name, frozen_array(getattr(instance, name), shape, name))
    except ValueError as error:
        raise PolicyError(str(error)) from error
