"""Every policy by name: how to make it, or how to train it. A new one adds a file and a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from data.types import Episode, Provenance, Task
from policy.base import Policy, PolicyError
from policy.features import input_set
from policy.gp_model import GpModel
from policy.gp_policy import GpPolicy
from policy.simple import Hold, RandomMoves, drag_rule, stretch_right


class Trainer(Protocol):
    """Learns a model from demonstrations."""

    def __call__(
        self,
        episodes: Sequence[Episode],
        *,
        seed: int = 0,
        provenance: Provenance | None = None,
        progress: Callable[[int, int, str], None] | None = None,
    ) -> GpModel: ...


MADE: Mapping[str, Callable[[Task], Policy]] = {
    "hold": Hold,
    "random": RandomMoves,
    "stretch-right": stretch_right,
    "drag-rule": drag_rule,
}
"""Policies that need no training."""


def _gp(name: str, inputs: str) -> Trainer:
    def train_gp(
        episodes: Sequence[Episode],
        *,
        seed: int = 0,
        provenance: Provenance | None = None,
        progress: Callable[[int, int, str], None] | None = None,
    ) -> GpModel:
        from policy import gp  # here, not above: who only rolls out need not have what only training needs

        if not episodes:
            raise PolicyError("there are no demonstrations to learn from; at least one is needed")
        layout = input_set(episodes[0].task, inputs)
        return gp.fit(episodes, layout, policy=name, seed=seed, provenance=provenance, progress=progress)

    return train_gp


TRAINED: Mapping[str, Trainer] = {
    "gp-word": _gp("gp-word", "all"),
    "gp-baseline": _gp("gp-baseline", "position"),
    "gp-contact": _gp("gp-contact", "position+contact"),
    "gp-direction": _gp("gp-direction", "position+word"),
}
"""Policies that are learned from demonstrations: the thesis's two, and the ablations of what they see in between."""

TRAINABLE = tuple(TRAINED)


def make(name: str, task: Task) -> Policy:
    """A policy that needs no training."""
    if name in TRAINED:
        raise PolicyError(f"policy {name!r} is learned; train it and give the model's file")
    if name not in MADE:
        raise PolicyError(f"policy {name!r} is unknown; it must be one of {', '.join(MADE)}")
    return MADE[name](task)


def train(
    name: str,
    episodes: Sequence[Episode],
    *,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> GpModel:
    """A model of a trainable policy."""
    if name not in TRAINED:
        raise PolicyError(f"policy {name!r} cannot be trained; it must be one of {', '.join(TRAINABLE)}")
    return TRAINED[name](episodes, seed=seed, provenance=provenance, progress=progress)


def from_model(model: GpModel) -> Policy:
    """The policy that a trained model makes."""
    if model.policy not in TRAINED:
        raise PolicyError(f"the model's policy {model.policy!r} is unknown; it must be one of {', '.join(TRAINABLE)}")
    return GpPolicy(model)
