"""Factories of policies: ``package.module:factory``, or a name of the entry-point group ``layflat.policies``.

The module may be in the current folder, as for other programs that take such a text. Its folder is searched last, so
that nothing in it can stand in for another module.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from importlib import import_module, metadata
from importlib.machinery import PathFinder
from pathlib import Path

from layflat.data.environment_spec import EnvironmentSpec
from layflat.policy.base import Policy, PolicyError
from layflat.policy.foreign.checked import CheckedPolicy, one_line

GROUP = "layflat.policies"
"""Group of entry points: name -> ``module:factory``."""
_TEXT = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")


@dataclass(frozen=True)
class PolicyFactory:
    """A callable that makes a policy for an `EnvironmentSpec`, by name, so that each process can look it up."""

    text: str
    """``module:name``."""
    folder: str = ""
    """Folder that holds the module; empty where it is installed."""

    @classmethod
    def find(cls, text: str) -> PolicyFactory | None:
        """Return the factory that a POLICY text names, or None where it names none; PolicyError for a broken one."""
        entry = next((point for point in metadata.entry_points(group=GROUP) if point.name == text), None)
        value = text if entry is None else f"{entry.module}:{entry.attr}"
        if not _TEXT.fullmatch(value):
            return None
        top = value.partition(":")[0].partition(".")[0]
        installed = top in sys.builtin_module_names or PathFinder.find_spec(top) is not None
        factory = cls(value, "" if installed else str(Path.cwd()))
        factory.load()
        return factory

    @property
    def label(self) -> str:
        """Name in tables."""
        module, _, name = self.text.partition(":")
        return f"{module.rpartition('.')[2]}.{name}"

    def load(self) -> object:
        """Import the module and return the callable."""
        module, _, name = self.text.partition(":")
        if self.folder and self.folder not in sys.path:
            sys.path.append(self.folder)
        try:
            found: object = import_module(module)
            for part in name.split("."):
                found = getattr(found, part)
        except AttributeError as error:
            raise PolicyError(f"policy {self.text!r}: module {module} has no {name}") from error
        except Exception as error:
            raise PolicyError(
                f"policy {self.text!r} cannot be imported, {type(error).__name__}: {one_line(error)}"
            ) from error
        if not callable(found):
            raise PolicyError(f"policy {self.text!r} is no class or function, but of type {type(found).__name__}")
        return found

    def make(self, spec: EnvironmentSpec, name: str) -> Policy:
        """Make the policy of an environment; PolicyError where the factory fails or makes none."""
        factory = self.load()
        try:
            policy = factory(spec)  # type: ignore[operator]
        except Exception as error:
            raise PolicyError(
                f"policy {self.text!r} failed on the environment's spec, {type(error).__name__}: {one_line(error)}"
            ) from error
        return CheckedPolicy(policy, name=name, robot=spec.robot)
