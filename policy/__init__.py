"""Policies: scripted, learned and hand-guided ones behind one protocol, and what trains, wraps and stores them.

`layflat.policy.registry` makes and trains them by name; `layflat.policy.model_io` stores trained models in files.
"""

from layflat.policy.base import Decision, Policy, PolicyError

__all__ = ["Decision", "Policy", "PolicyError"]
