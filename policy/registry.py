"""Every policy by name: how to make it, or how to train it. A new one adds a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, Protocol

from layflat.data.robot import RobotSpec
from layflat.data.types import Episode, Provenance
from layflat.policy import finishing_policy
from layflat.policy.base import Policy, PolicyError
from layflat.policy.dmp.model import DmpModel
from layflat.policy.dmp.policy import DmpPolicy
from layflat.policy.features import input_set
from layflat.policy.gp.model import GpModel
from layflat.policy.model_policy import ModelPolicy
from layflat.policy.scripted.baselines import RandomPolicy, ZeroPolicy, drag_rule, stretch_right
from layflat.policy.trained_model import RegressionModel, TrainedModel
from layflat.policy.wrappers.recovery import RecoveryWrapper
from layflat.policy.wrappers.swing_damping import SwingDampingWrapper


class Trainer(Protocol):
    """Learns a model from demonstrations."""

    def __call__(
        self,
        episodes: Sequence[Episode],
        *,
        seed: int = 0,
        provenance: Provenance | None = None,
        progress: Callable[[int, int, str], None] | None = None,
        **options: Any,
    ) -> TrainedModel: ...


BUILTIN_POLICIES: Mapping[str, Callable[[RobotSpec], Policy]] = {
    "hold": ZeroPolicy,
    "random": RandomPolicy,
    "stretch-right": stretch_right,
    "drag-rule": drag_rule,
}
"""Policies that need no training."""

WRAPPERS: Mapping[str, Callable[[Policy], Policy]] = {"steady": SwingDampingWrapper, "recovery": RecoveryWrapper}
"""What any policy can have around it."""

RECOMMENDED_WRAPPERS = ("recovery", "steady")
"""All of them as they are made for each other: steadiness outermost, so that it also waits while recovery lowers."""


def _learner(module: str, name: str, inputs: str) -> Trainer:
    """``fit`` of a module of this package, on one input set."""

    def train_one(
        episodes: Sequence[Episode],
        *,
        seed: int = 0,
        provenance: Provenance | None = None,
        progress: Callable[[int, int, str], None] | None = None,
        **options: Any,
    ) -> TrainedModel:
        if not episodes:
            raise PolicyError("there are no demonstrations to learn from; at least one is needed")
        # Imported here: who only rolls out need not have, nor wait for, what only training needs.
        fit = import_module(f"layflat.policy.{module}").fit
        layout = input_set(episodes[0].robot, inputs)
        model: TrainedModel = fit(
            episodes, layout, policy=name, seed=seed, provenance=provenance, progress=progress, **options
        )
        return model

    return train_one


TRAINERS: Mapping[str, Trainer] = {
    name: _learner(module, name, inputs)
    for name, module, inputs in (
        ("gp-word", "gp.fit", "all"),
        ("gp-baseline", "gp.fit", "position"),
        ("gp-contact", "gp.fit", "position+contact"),
        ("gp-direction", "gp.fit", "position+word"),
        (finishing_policy.NAME, "gp.fit", "all"),
        ("gmr", "gmr.fit", "all"),
        ("dmp", "dmp.policy", "position"),
        ("nearest", "nearest.model", "all"),
    )
}
"""Policies that are learned from demonstrations: the thesis's two, the ablations of what they see in between, and other
methods (section 5-3). Each is a module with a ``fit`` and what it may see."""

TRAINABLE_POLICIES = tuple(TRAINERS)


def make(name: str, robot: RobotSpec) -> Policy:
    """A policy that needs no training."""
    if name in TRAINERS:
        raise PolicyError(f"policy {name!r} is learned; train it and give the model's file")
    if name not in BUILTIN_POLICIES:
        raise PolicyError(f"policy {name!r} is unknown; it must be one of {', '.join(BUILTIN_POLICIES)}")
    return BUILTIN_POLICIES[name](robot)


def train(
    name: str,
    episodes: Sequence[Episode],
    *,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Callable[[int, int, str], None] | None = None,
    intervention_weight: int = 1,
) -> TrainedModel:
    """A model of a trainable policy; ``intervention_weight`` is as in layflat.policy.gp.fit.FitOptions, for Gaussian
    processes."""
    if name not in TRAINERS:
        raise PolicyError(f"policy {name!r} cannot be trained; it must be one of {', '.join(TRAINABLE_POLICIES)}")
    options: dict[str, Any] = {}
    if intervention_weight != 1:
        if not name.startswith("gp-"):
            raise PolicyError(f"{name} cannot weight what a person corrected; the policies that can begin with gp-")
        from layflat.policy.gp.fit import FitOptions

        options["options"] = FitOptions(intervention_weight=intervention_weight)
    return TRAINERS[name](episodes, seed=seed, provenance=provenance, progress=progress, **options)


def from_model(model: TrainedModel) -> Policy:
    """The policy that a trained model makes."""
    if model.policy not in TRAINERS:
        raise PolicyError(
            f"the model's policy {model.policy!r} is unknown; it must be one of {', '.join(TRAINABLE_POLICIES)}"
        )
    if model.policy == finishing_policy.NAME and isinstance(model, GpModel):
        return finishing_policy.FinishingPolicy(model)
    if isinstance(model, DmpModel):
        return DmpPolicy(model)
    if isinstance(model, RegressionModel):
        return ModelPolicy(model)
    raise PolicyError(f"there is no policy for a {type(model).__name__}")


def wrap(policy: Policy, names: Sequence[str]) -> Policy:
    """``policy`` within each of WRAPPERS, the last one outermost."""
    for name in names:
        if name not in WRAPPERS:
            raise PolicyError(f"there is no {name!r} to put around a policy; it must be one of {', '.join(WRAPPERS)}")
        policy = WRAPPERS[name](policy)
    return policy
