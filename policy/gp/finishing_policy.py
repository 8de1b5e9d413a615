"""FinishingPolicy (``gp-finish``): Gaussian processes whose motion does not fade out before the cloth is flat.

A process answers zero where it has no data, so that the thesis's policy stands still outside of its demonstrations
(section 5-1). With all inputs divided by their scales, this policy (see ``docs/explanation/policies.md``):

- queries the processes at most RADIUS from the nearest demonstrated step, so that their mean never fades;
- in the air moves back towards that step, in proportion to its distance beyond RADIUS;
- makes at least the smallest useful move while the cloth is not flat: on the table to the front, and down to the
  height at which the demonstrations ended, since a held edge that hovers keeps its wrinkles;
- stops because the cloth is flat or nothing helps any more, not because its output is small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from layflat.data.arrays import FloatArray
from layflat.data.types import Observation
from layflat.policy.base import Decision
from layflat.policy.gp.model import GpModel
from layflat.policy.stopping import AnyOf, NoContactGain, RuleStoppedPolicy, StopRule, Stuck, contact_reached, x_limit

RADIUS = 0.5
"""In scales of the inputs (5 cm, a tenth of contact, half a unit of WORD): for 95 % of a demonstration's steps, the
nearest step of another one is closer than 0.43 (hanger) and 0.50 (pickers), n = 10 each."""
PULL = 0.15
"""Share of the way back made in one step."""
PULL_BELOW_CONTACT = 0.5
"""Above this contact portion the cloth lies on the table, and a way back would push it into folds."""
USEFUL_M = 0.004
"""Smallest useful move; the scripted demonstrator's slowest drag is 3 mm."""
ON_TABLE_CONTACT, FLAT_CONTACT, FLAT_STEPS = 0.8, 0.99, 6
NO_GAIN_STEPS = 25
"""Ten centimetres of the smallest useful move: slack that is drawn together may hide contact for as long as that."""
STUCK_STEPS, STUCK_M = 40, 0.02
"""So many smallest useful moves make 16 cm."""
NOISE_M = 2e-4
"""Output below which its direction is noise."""


class Neighbour(NamedTuple):
    """Demonstrated step that is most similar to the current one."""

    distance: float
    """In scales of the inputs."""
    query: FloatArray
    """(D,) features for the processes in natural units, at most RADIUS from the demonstrated step."""
    way_back: FloatArray
    """(A,) m: from the current coordinates to those of the demonstrated step, less RADIUS; zeros inside."""


class FinishingPolicy(RuleStoppedPolicy):
    """Places the cloth until it is flat or nothing helps any more."""

    def __init__(self, model: GpModel, *, stop: StopRule | None = None) -> None:
        super().__init__(model.policy, model.layout.robot, default_stop_rule() if stop is None else stop)
        self.model = model
        self._points = model.inputs / model.input_scale
        self._coordinates = [model.layout.names.index(name) for name in self.robot.coordinates]
        self._is_height = np.array([axis.axis == 2 for axis in self.robot.axes])
        self._rest = resting_point(model)[self._coordinates]

    def act(self, observation: Observation) -> Decision:
        """Decide one step."""
        features = self.model.layout.vector(observation)
        neighbour = self.nearest(features)
        (wanted,), (std,) = self.model.predict(neighbour.query[np.newaxis])
        if observation.contact_portion < PULL_BELOW_CONTACT:
            wanted = wanted + PULL * neighbour.way_back
        wanted, reason = self._at_least_useful(wanted, features[self._coordinates], observation)
        action = np.clip(wanted, -self.model.action_limit_m, self.model.action_limit_m)
        if neighbour.distance > RADIUS:
            reason = f"{reason}, {neighbour.distance:.1f} scales from the demonstrations"
        return self._decide(observation, action, reason, std=std)

    def nearest(self, features: FloatArray) -> Neighbour:
        """Find the demonstrated step nearest to ``features`` (D,), in natural units."""
        scaled = features / self.model.input_scale
        distances = cdist(scaled[np.newaxis], self._points)[0]
        k = int(distances.argmin())
        share = min(1.0, RADIUS / max(float(distances[k]), RADIUS))
        query = self._points[k] + share * (scaled - self._points[k])
        back = (1 - share) * (self.model.inputs[k] - features)[self._coordinates]
        return Neighbour(float(distances[k]), query * self.model.input_scale, back)

    def _at_least_useful(
        self, wanted: FloatArray, position: FloatArray, observation: Observation
    ) -> tuple[FloatArray, str]:
        """Return ``wanted`` or the smallest useful move from ``position`` (A,) m, and the reason for it."""
        least, norm = self.robot.pack([USEFUL_M, 0.0, 0.0]), float(np.linalg.norm(wanted))
        if norm >= np.linalg.norm(least):
            return wanted, f"output {1000 * norm:.1f} mm"
        if observation.contact_portion >= FLAT_CONTACT:
            return np.zeros_like(wanted), "flat"
        if observation.contact_portion >= ON_TABLE_CONTACT or norm < NOISE_M:
            forward = np.where(least > 0, np.maximum(wanted, least), wanted)
            # Only where the output is small: on top of a landing, a way down would throw the cloth into folds.
            return forward + self._down(position), "not flat yet: a useful move to the front"
        return wanted * float(np.linalg.norm(least)) / norm, "not flat yet: a useful move"

    def _down(self, position: FloatArray) -> FloatArray:
        """Return (A,) m towards the height at which the demonstrations ended: never up, at most a useful move."""
        away = np.where(self._is_height, self._rest - position, 0.0)
        return np.clip(PULL * away, -USEFUL_M, 0.0)


def resting_point(model: GpModel) -> FloatArray:
    """Return (D,) the median of the demonstrated steps in which the cloth lay flat, or of all if there are none."""
    names, points = model.layout.names, model.inputs
    flat = points[points[:, names.index("contact")] >= FLAT_CONTACT] if "contact" in names else points[:0]
    rest: FloatArray = np.median(flat if len(flat) else points, axis=0)
    return rest


def default_stop_rule() -> StopRule:
    """Return a rule that stops when the cloth is flat, gains nothing, is stuck, or is at the end of the view."""
    return AnyOf(
        contact_reached(FLAT_CONTACT, n_steps=FLAT_STEPS),
        NoContactGain(n_steps=NO_GAIN_STEPS, from_contact=ON_TABLE_CONTACT),
        Stuck(n_steps=STUCK_STEPS, within_m=STUCK_M),
        x_limit(),
    )
