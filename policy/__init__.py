"""Who decides: hand-written, scripted and learned policies behind one protocol.

``layflat.policy.registry`` makes and trains them by name, ``layflat.policy.model_io`` keeps what was learned in files.
"""

from layflat.policy.base import Decision, Policy, PolicyError

__all__ = ["Decision", "Policy", "PolicyError"]
