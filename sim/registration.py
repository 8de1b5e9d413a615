"""Registration of the Gymnasium environments."""

from __future__ import annotations

MAX_EPISODE_STEPS = 200
"""Steps after which an environment truncates: 20 s."""
ENTRY_POINT = "layflat.sim.env:ClothPlaceEnv"
ENVIRONMENTS: dict[str, dict[str, str]] = {
    "layflat/ClothPlace-v0": {},
    "layflat/HangerPlace-v0": {"robot": "hanger"},
    "layflat/PickersPlace-v0": {"robot": "pickers"},
}
"""Arguments of each id; the last two are the first with a robot."""


def register_environments() -> None:
    """Register `ENVIRONMENTS` with Gymnasium, unless they are registered already."""
    from gymnasium.envs.registration import register, registry

    for name, arguments in ENVIRONMENTS.items():
        if name not in registry:
            register(id=name, entry_point=ENTRY_POINT, max_episode_steps=MAX_EPISODE_STEPS, kwargs=dict(arguments))
