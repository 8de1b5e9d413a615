"""Who decides: hand-written, scripted and learned policies behind one protocol.

``policy.registry`` makes and trains them by name, ``policy.model`` keeps what was learned in files.
"""

from policy.base import Decision, Policy, PolicyError

__all__ = ["Decision", "Policy", "PolicyError"]
