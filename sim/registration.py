"""Registration of the Gymnasium environments without an import of Gymnasium, which is slower than `layflat --help`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

MAX_EPISODE_STEPS = 200
"""Steps after which an environment truncates: 20 s."""
ENVIRONMENTS: dict[str, dict[str, str]] = {
    "layflat/ClothPlace-v0": {},
    "layflat/HangerPlace-v0": {"robot": "hanger"},
    "layflat/PickersPlace-v0": {"robot": "pickers"},
}
"""Arguments of each id; the last two are aliases of the first with a robot."""


def register_environments() -> None:
    """Register `ENVIRONMENTS` with Gymnasium now, or as soon as it is imported."""
    if "gymnasium" not in sys.modules:
        if not any(isinstance(finder, _GymnasiumHook) for finder in sys.meta_path):
            sys.meta_path.insert(0, _GymnasiumHook())
        return
    from gymnasium.envs.registration import register, registry

    for name, arguments in ENVIRONMENTS.items():
        if name not in registry:
            entry_point, limit = "layflat.sim.env:ClothPlaceEnv", MAX_EPISODE_STEPS
            register(id=name, entry_point=entry_point, max_episode_steps=limit, kwargs=dict(arguments))


class _GymnasiumHook:
    """Registers the environments after the first import of Gymnasium."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            loader: Any = spec.loader
            run = loader.exec_module

            def run_and_register(module: ModuleType) -> None:
                run(module)
                register_environments()

            loader.exec_module = run_and_register
        return spec
