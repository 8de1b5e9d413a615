"""The one call that a command of the command line makes."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from importlib import import_module
from typing import Any, get_type_hints

from layflat.app.support import validators


def call(function: str, options: Mapping[str, Any], *, simulator: bool = True) -> Any:
    """Call ``function``, such as "commands.place:place", with a config of the ``options`` that were given.

    Options that are parameters of the function itself (``workers``, ``force``) are passed to it. The others are fields
    of its config, where the field's default stands for an option that was left out; ``physics`` is one of its
    settings. What is heavy is imported here,
    so that ``layflat --help`` answers at once. ``simulator``: whether the command needs one.
    """
    if simulator:
        validators.require_simulator()
    module, _, name = function.partition(":")
    work = getattr(import_module(f"layflat.app.{module}"), name)
    config_type = get_type_hints(work)["config"]
    parameters = inspect.signature(work).parameters
    own = {key: value for key, value in options.items() if key in parameters}
    options = dict(options)
    if physics := options.pop("physics", None):
        options["settings"] = [*(options.get("settings") or ()), f"physics={physics}"]
    fields = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in options.items()
        if key not in (*parameters, "debug") and value is not None
    }
    return work(config_type(**fields), **own)
