"""Who decides in an episode: a model, a policy by name, the demonstrator, and what is around them."""

from __future__ import annotations

from collections.abc import Sequence

from layflat.policy import registry
from layflat.policy.base import Policy
from layflat.policy.scripted import wrinkle_removal
from layflat.policy.scripted.demonstrator import ScriptedDemonstrator
from layflat.policy.trained_model import TrainedModel
from layflat.policy.wrappers.sequential import SequentialPolicy
from layflat.sim.cloth.cloth import HELD_STRETCH
from layflat.sim.simulation import ClothSimulation

SCRIPTED = ScriptedDemonstrator.name


def make_policy(
    bench: ClothSimulation,
    *,
    name: str,
    model: TrainedModel | None = None,
    made: str | None = None,
    controller: str | None = None,
    decorators: Sequence[str] = (),
) -> Policy:
    """A controller of wrinkle removal, or a model after which ``made`` repairs, or ``made`` alone, or the demonstrator.

    The demonstrator, who alone sees the mesh, is shown that of ``bench``. ``decorators`` come around it in their order.
    """
    if controller is not None:
        return wrinkle_removal.controller(controller, bench.spec.robot)
    robot = bench.spec.robot
    if model is None:
        policy = _scripted(bench) if made in (None, SCRIPTED) else registry.make(str(made), robot)
    else:
        policy = registry.from_model(model)
        if made is not None:
            policy = SequentialPolicy(policy, registry.make(made, robot), name=name)
    return registry.wrap(policy, decorators)


def _scripted(bench: ClothSimulation) -> Policy:
    cloth = bench.config.cloth_spec
    return ScriptedDemonstrator(
        bench.spec.robot,
        length_m=cloth.length_m,
        columns=cloth.columns,
        held_width_m=HELD_STRETCH * cloth.width_m,
        ground_truth=bench.ground_truth,
    )
