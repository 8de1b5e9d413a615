"""All policies by name: how to make them and how to train them. A new policy adds a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from layflat.data.robot import RobotSpec
from layflat.data.types import Episode, Provenance
from layflat.policy.base import Policy, PolicyError
from layflat.policy.dmp import DmpModel, DmpPolicy
from layflat.policy.features import Frame
from layflat.policy.gmr import GmrModel
from layflat.policy.gp.finishing_policy import FinishingPolicy
from layflat.policy.gp.model import GpModel
from layflat.policy.model_policy import ModelPolicy
from layflat.policy.nearest import NearestModel
from layflat.policy.scripted.baselines import RandomPolicy, ZeroPolicy, drag_rule, stretch_right
from layflat.policy.trained_model import Progress, TrainedModel, ignore_progress
from layflat.policy.training_set import Demonstrations, build_training_set
from layflat.policy.wrappers.recovery import RecoveryWrapper
from layflat.policy.wrappers.swing_damping import SwingDampingWrapper

BUILTIN_POLICIES: Mapping[str, Callable[[RobotSpec], Policy]] = {
    "hold": ZeroPolicy,
    "random": RandomPolicy,
    "stretch-right": stretch_right,
    "drag-rule": drag_rule,
}
"""Policies that need no training."""

WRAPPERS: Mapping[str, Callable[[Policy], Policy]] = {"steady": SwingDampingWrapper, "recovery": RecoveryWrapper}
"""Wrappers for any policy."""

RECOMMENDED_WRAPPERS = ("recovery", "steady")
"""All wrappers in the order for which they are made: ``steady`` outermost, so that it also acts during a recovery."""


@dataclass(frozen=True)
class Learner:
    """A policy that is learned from demonstrations."""

    fit: str
    """Module of this package whose ``fit`` trains the model; imported when needed, because a rollout does not."""
    inputs: str
    """Name of the input set, see `layflat.policy.features.INPUT_SETS`."""
    model: type[TrainedModel]
    policy: Callable[[Any], Policy]
    """Makes the policy that runs the model."""


LEARNERS: Mapping[str, Learner] = {
    "gp-word": Learner("gp.fit", "all", GpModel, ModelPolicy),
    "gp-baseline": Learner("gp.fit", "position", GpModel, ModelPolicy),
    "gp-contact": Learner("gp.fit", "position+contact", GpModel, ModelPolicy),
    "gp-direction": Learner("gp.fit", "position+word", GpModel, ModelPolicy),
    "gp-finish": Learner("gp.fit", "all", GpModel, FinishingPolicy),
    "gmr": Learner("gmr", "all", GmrModel, ModelPolicy),
    "dmp": Learner("dmp", "position", DmpModel, DmpPolicy),
    "nearest": Learner("nearest", "all", NearestModel, ModelPolicy),
}
"""The thesis's two policies, ablations of their inputs, and other methods (section 5-3)."""

TRAINABLE_POLICIES = tuple(LEARNERS)


def make(name: str, robot: RobotSpec) -> Policy:
    """Make one of BUILTIN_POLICIES; PolicyError if the name is unknown, or that of a policy that must be trained."""
    if name in LEARNERS:
        raise PolicyError(f"policy {name!r} is learned; train it and give the model's file")
    return _known("policy", name, BUILTIN_POLICIES)(robot)


def train(
    name: str,
    demonstrations: Demonstrations | Sequence[Episode],
    *,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Progress | None = None,
    intervention_weight: int = 1,
    frame: Frame | None = None,
) -> TrainedModel:
    """Train a model of one of TRAINABLE_POLICIES; `from_model` makes its policy.

    The caller chooses which demonstrations are worth learning from; steps of the phase ``disturb`` are left out.
    ``frame`` is that of positions and actions: None is the cloth's, in which the policy lays cloths of any size, where
    every cloth's size is known; ``world`` is the thesis's. Gaussian processes may give steps in which a person
    corrected a policy a larger ``intervention_weight``. PolicyError if the policy cannot be trained, or the
    demonstrations are too few or do not belong together.
    """
    learner = _known("trainable policy", name, LEARNERS)
    options: dict[str, Any] = {}
    if intervention_weight != 1:
        if learner.model is not GpModel:
            raise PolicyError(f"{name} cannot weight interventions; use a policy whose name begins with gp-")
        from layflat.policy.gp.fit import FitOptions

        options["options"] = FitOptions(intervention_weight=intervention_weight)
    training = build_training_set(
        demonstrations, learner.inputs, policy=name, frame=frame, seed=seed, provenance=provenance
    )
    fit: Callable[..., TrainedModel] = import_module(f"layflat.policy.{learner.fit}").fit
    return fit(training, progress or ignore_progress, **options)


def from_model(model: TrainedModel) -> Policy:
    """Make the policy that runs a model; PolicyError if it names an unknown policy, or one of another method."""
    learner = _known("the model's policy", model.policy, LEARNERS)
    if not isinstance(model, learner.model):
        raise PolicyError(f"a {type(model).__name__} cannot be run as {model.policy}; train it again")
    return learner.policy(model)


def wrap(policy: Policy, names: Sequence[str]) -> Policy:
    """Put the named WRAPPERS around a policy, the last one outermost; PolicyError lists the known names."""
    for name in names:
        policy = _known("wrapper", name, WRAPPERS)(policy)
    return policy


def _known(kind: str, name: str, known: Mapping[str, Any]) -> Any:
    if name not in known:
        raise PolicyError(f"{kind} {name!r} is unknown; it must be one of {', '.join(known)}")
    return known[name]
