"""Layflat teaches a robot to lay cloth flat.

>>> env = layflat.make_env(robot="hanger", cloth="towel")
>>> policy = layflat.load_policy("word.npz")
>>> episode = layflat.rollout(env, policy, seed=7)
>>> with layflat.open_session("demos.h5") as session:
...     columns = session.arrays(["obs/word", "action_m"])

Everything heavy is imported when it is first used.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

# Before any import that an older interpreter could not parse; pip refuses these, `python3 -m ...doctor` does not.
if sys.version_info < (3, 10):  # noqa: UP036
    sys.exit(f"Layflat needs Python 3.11 or 3.10; this is Python {sys.version_info[0]}.{sys.version_info[1]}.")

from layflat.sim.registration import register_environments

if TYPE_CHECKING:
    from layflat.data.environment_spec import EnvironmentSpec
    from layflat.data.robot import RobotSpec
    from layflat.data.session.reader import Session, open_session
    from layflat.data.types import DisturbanceRecord, Episode, GroundTruth, Observation, Step
    from layflat.policy.base import Decision, Policy
    from layflat.policy.environment import Environment
    from layflat.policy.rollout import rollout
    from layflat.policy.spec import PolicySpec
    from layflat.sim.simulation import ClothSimulation

__all__ = [
    "Decision",
    "DisturbanceRecord",
    "Environment",
    "EnvironmentSpec",
    "Episode",
    "GroundTruth",
    "Observation",
    "Policy",
    "PolicySpec",
    "RobotSpec",
    "Session",
    "Step",
    "__version__",
    "load_policy",
    "make_env",
    "open_session",
    "rollout",
]

_PLACES = {
    "Decision": "layflat.policy.base",
    "DisturbanceRecord": "layflat.data.types",
    "Environment": "layflat.policy.environment",
    "EnvironmentSpec": "layflat.data.environment_spec",
    "Episode": "layflat.data.types",
    "GroundTruth": "layflat.data.types",
    "Observation": "layflat.data.types",
    "Policy": "layflat.policy.base",
    "PolicySpec": "layflat.policy.spec",
    "RobotSpec": "layflat.data.robot",
    "Session": "layflat.data.session.reader",
    "Step": "layflat.data.types",
    "open_session": "layflat.data.session.reader",
    "rollout": "layflat.policy.rollout",
}
"""Module of each name that is imported when it is first used."""

register_environments()


def make_env(
    robot: str = "hanger", task: str = "place", cloth: str = "towel", physics: str = "bullet", **settings: Any
) -> ClothSimulation:
    """Make a simulated environment.

    Parameters
    ----------
    robot
        ``hanger`` (a Panda arm with a two-clip hanger, moves in x and z) or ``pickers`` (two free pickers).
    task
        ``place``, or ``smooth`` from a crumpled start.
    cloth
        A name that ``layflat cloth list`` prints, such as ``towel``, or a cloth file, ``FILE.toml``.
    physics
        ``bullet``.
    **settings
        Further fields of `layflat.sim.config.SimConfig`, such as ``start``, ``descriptor`` and ``noise``, and every
        condition of `layflat config`, such as ``mass_factor`` or ``camera_z_m``.

    Returns
    -------
    ClothSimulation
        An `Environment`: ``reset(seed)``, ``observe()``, ``step(action)``, ``ground_truth()``, ``disturb(name)``,
        ``close()``. One a process: Bullet repeats itself to the bit only in a process that has not stepped before.

    Raises
    ------
    layflat.sim.errors.SimError
        Where a name is unknown or a value impossible; the message lists what is possible.
    """
    from layflat.sim.config import SimConfig
    from layflat.sim.simulation import ClothSimulation

    return ClothSimulation(SimConfig.of(robot=robot, task=task, cloth=cloth, physics=physics, **settings))


def load_policy(text: str) -> PolicySpec:
    """Read a POLICY text, as the command line takes it.

    Parameters
    ----------
    text
        ``MODEL.npz``; the name of a built-in policy (``scripted``, ``hold``, ``random``, ``stretch-right``,
        ``drag-rule``); ``package.module:factory`` or the name of an entry point; or a policy server,
        ``ws://HOST:PORT``. Behind it ``+recovery``, ``+steady`` or, except behind a built-in one, a built-in policy
        that repairs.

    Returns
    -------
    PolicySpec
        What `rollout` takes; ``make(env)`` makes the policy itself.

    Raises
    ------
    layflat.policy.base.PolicyError
        Where there is no such file or name, the file is no model, or the factory is none.
    """
    from layflat.policy.spec import PolicySpec

    return PolicySpec.parse(text)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib import metadata  # It imports much, before `layflat.app.cli.entry` has put PYTHONPATH last.

        return metadata.version("layflat")
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
