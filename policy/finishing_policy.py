"""``gp-finish``: the motion of the Gaussian processes, which does not fade out before the cloth is flat.

What a process does not know it answers with zero, so that the thesis's policy stands still wherever it has not been
taught (section 5-1). Here, with all inputs divided by their scales (``docs/explanation/policies.md`` has the reasons):

- it asks the processes no farther than RADIUS from the nearest demonstrated step, so that their mean never fades;
- in the air it is drawn back to where that step was, in proportion to how far outside of RADIUS it is;
- while the cloth is not flat it makes at least the smallest move that helps: on the table to the front, and down to the
  height at which the demonstrations ended, since a held edge that hovers keeps its wrinkles;
- it stops because the cloth is flat, or because nothing helps any more, and not because its output is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from layflat.data.arrays import FloatArray
from layflat.data.types import Observation
from layflat.policy.base import Decision
from layflat.policy.gp.model import GpModel
from layflat.policy.scripted.baselines import X_LIMIT_M
from layflat.policy.stopping import AnyOf, ContactReached, NoContactGain, StopRule, Stuck, XLimit

NAME = "gp-finish"
RADIUS = 0.5
"""In scales of the inputs (5 cm, a tenth of contact, half a unit of WORD): of a demonstration's steps 95 % have one of
another demonstration nearer than 0.43 (hanger) and 0.50 (pickers), n = 10 each."""
PULL = 0.15
"""Share of the way back that is made in one step."""
PULL_BELOW_CONTACT = 0.5
"""Above, the cloth lies on the table and would be pushed into folds on the way back."""
USEFUL_M = 0.004
"""Smallest move of the holder that helps: the scripted demonstrator's slowest drag is 3 mm."""
ON_TABLE_CONTACT = 0.8
FLAT_CONTACT = 0.99
FLAT_STEPS = 6
NO_GAIN_STEPS = 25
"""Ten centimetres of the smallest useful move: slack that is drawn together may hide contact for as long as that."""
STUCK_STEPS = 40
STUCK_M = 0.02
"""A smallest useful move at a time makes 16 cm in so many steps."""
LOST_M = 2e-4
"""Output below which its direction is noise."""


@dataclass(frozen=True, kw_only=True)
class Nearest:
    """The demonstrated step that is most like what is seen now."""

    distance: float
    """In scales of the inputs."""
    query: FloatArray
    """(D,) what to ask the processes, natural units: no farther than RADIUS from that step."""
    way_back: FloatArray
    """(A,) m: from where the holder is to where it was in that step, less RADIUS; zeros inside."""


class FinishingPolicy:
    """Places until the cloth is flat or nothing helps any more."""

    def __init__(self, model: GpModel, *, stop: StopRule | None = None) -> None:
        self.model = model
        self.name = model.policy
        self.robot = model.layout.robot
        self._stop = finished() if stop is None else stop
        self._points = model.inputs / model.input_scale
        self._places = [model.layout.names.index(name) for name in self.robot.coordinates]
        self._is_height = np.array([axis.axis == 2 for axis in self.robot.axes])
        self._rest = resting_place(model)[self._places]

    def reset(self, seed: int) -> None:
        self._stop.reset()

    def resume(self) -> None:
        self._stop.reset()

    def act(self, observation: Observation) -> Decision:
        features = self.model.layout.vector(observation)
        near = self.nearest(features)
        means, stds = self.model.predict(near.query[np.newaxis])
        in_the_air = observation.contact_portion < PULL_BELOW_CONTACT
        wanted = means[0] + PULL * near.way_back if in_the_air else means[0]
        wanted, why = self._useful(wanted, features[self._places], observation)
        action = np.clip(wanted, -self.model.action_limit_m, self.model.action_limit_m)
        stop = self._stop.update(observation, action)
        if stop is not None:
            return Decision(action=np.zeros_like(action), std=stds[0], stop=stop.by, reason=stop.reason)
        if near.distance > RADIUS:
            why = f"{why}, {near.distance:.1f} scales from the demonstrations"
        return Decision(action=action, std=stds[0], reason=why)

    def nearest(self, features: FloatArray) -> Nearest:
        """What the demonstrations have that is most like ``features`` (D,), natural units."""
        scaled = features / self.model.input_scale
        distances = cdist(scaled[np.newaxis], self._points)[0]
        k = int(distances.argmin())
        share = min(1.0, RADIUS / max(float(distances[k]), RADIUS))
        query = self._points[k] + share * (scaled - self._points[k])
        back = (1 - share) * (self.model.inputs[k] - features)[self._places]
        return Nearest(distance=float(distances[k]), query=query * self.model.input_scale, way_back=back)

    def _useful(self, wanted: FloatArray, place: FloatArray, observation: Observation) -> tuple[FloatArray, str]:
        """``wanted``, or the smallest move that helps the holder at ``place`` (A,); and a clause that says which."""
        least, norm = self.robot.pack([USEFUL_M, 0.0, 0.0]), float(np.linalg.norm(wanted))
        if norm >= np.linalg.norm(least):
            return wanted, f"output {1000 * norm:.1f} mm"
        if observation.contact_portion >= FLAT_CONTACT:
            return np.zeros_like(wanted), "flat"
        if observation.contact_portion >= ON_TABLE_CONTACT or norm < LOST_M:
            forward = np.where(least > 0, np.maximum(wanted, least), wanted)
            return forward + self._down(place), "not flat yet: a useful move to the front"
        return wanted * float(np.linalg.norm(least)) / norm, "not flat yet: a useful move"

    def _down(self, place: FloatArray) -> FloatArray:
        """(A,) m: towards the height at which the demonstrations ended; never up, and no faster than a useful move.

        Only where the processes ask for next to nothing: on top of a landing it would throw the cloth into folds.
        """
        away = np.where(self._is_height, self._rest - place, 0.0)
        return np.clip(PULL * away, -USEFUL_M, 0.0)


def resting_place(model: GpModel) -> FloatArray:
    """(D,) median of the demonstrated steps in which the cloth lay flat, or of all where none did."""
    names, n_steps = model.layout.names, model.inputs
    flat = n_steps[n_steps[:, names.index("contact")] >= FLAT_CONTACT] if "contact" in names else n_steps[:0]
    rest: FloatArray = np.median(flat if len(flat) else n_steps, axis=0)
    return rest


def finished() -> StopRule:
    """Flat, or no gain any more, or stuck, or at the end of the view; the reason says which."""
    return AnyOf(
        ContactReached(FLAT_CONTACT, n_steps=FLAT_STEPS),
        NoContactGain(n_steps=NO_GAIN_STEPS, from_contact=ON_TABLE_CONTACT),
        Stuck(n_steps=STUCK_STEPS, within_m=STUCK_M),
        XLimit(X_LIMIT_M),
    )
