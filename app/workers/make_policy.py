"""Who decides in an episode: a model, a policy by name, the demonstrator, and what is around them."""

from __future__ import annotations

from collections.abc import Sequence

from layflat.policy import registry
from layflat.policy.base import Policy
from layflat.policy.scripted import wrinkle_removal
from layflat.policy.scripted.demonstrator import ScriptedExpert
from layflat.policy.trained_model import Learned
from layflat.policy.wrappers.sequential import Handover
from layflat.sim.cloth.cloth import HELD_STRETCH
from layflat.sim.simulation import Placing

SCRIPTED = ScriptedExpert.name


def player(
    bench: Placing,
    *,
    name: str,
    model: Learned | None = None,
    made: str | None = None,
    controller: str | None = None,
    decorators: Sequence[str] = (),
) -> Policy:
    """A controller of wrinkle removal, or a model after which ``made`` repairs, or ``made`` alone, or the demonstrator.

    The demonstrator, who alone sees the mesh, is shown that of ``bench``. ``decorators`` come around it in their order.
    """
    if controller is not None:
        return wrinkle_removal.controller(controller)
    task = bench.settings.task
    if model is None:
        policy = _scripted(bench) if made in (None, SCRIPTED) else registry.make(str(made), task)
    else:
        policy = registry.from_model(model)
        if made is not None:
            policy = Handover(policy, registry.make(made, task), name=name)
    return registry.decorated(policy, decorators)


def _scripted(bench: Placing) -> Policy:
    spec = bench.settings.spec
    return ScriptedExpert(
        bench.settings.task,
        length_m=spec.length_m,
        columns=spec.columns,
        held_width_m=HELD_STRETCH * spec.width_m,
        look=bench.truth,
    )
