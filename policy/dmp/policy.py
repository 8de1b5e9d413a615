"""Learns a dynamic movement primitive from demonstrations, and rolls it out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Episode, Observation, Provenance, actions_of
from layflat.policy.base import Decision, PolicyError
from layflat.policy.dmp.model import DmpModel, Motion, advanced, at_rest, path
from layflat.policy.features import FeatureLayout
from layflat.policy.model_policy import stop_rule
from layflat.policy.stopping import StopRule
from layflat.policy.training_set import build_training_set

BASIS = 25
RIDGE = 1e-6
"""Keeps weights of basis functions that hardly move anything small; relative to the mean square of their responses."""


class DmpPolicy:
    """Follows the primitive from where the holder is at first, whatever the cloth does; then rests at its goal.

    Its actions are the primitive's own steps, so that what the holder lags behind does not add up.
    """

    def __init__(self, model: DmpModel, *, guard: StopRule | None = None) -> None:
        self.model = model
        self.name = model.policy
        self.robot = model.layout.robot
        self._stop = stop_rule(model, guard)
        self._start: FloatArray | None = None

    def reset(self, seed: int) -> None:
        self._stop.reset()
        self._start = None

    def resume(self) -> None:
        """The primitive is not begun again: it goes on from where it was."""
        self._stop.reset()

    def act(self, observation: Observation) -> Decision:
        model, limit = self.model, self.model.action_limit_m
        if self._start is None:
            self._start = model.layout.vector(observation)
            self._motion: Motion = at_rest(self._start)
            self._commanded = self._start
        self._motion = advanced(self._motion, model.step_u, self._start, model.goal, model.weights)
        # What the limit cuts off is made up for in the next steps.
        action = np.clip(self._motion.position - self._commanded, -limit, limit)
        stop = self._stop.update(observation, action)
        if stop is not None:
            return Decision(action=np.zeros_like(action), stop=stop.by, reason=stop.reason)
        self._commanded = self._commanded + action
        return Decision(action=action, reason=f"{100 * min(self._motion.u, 1.0):.0f} % of the way")


def fit(
    episodes: Sequence[Episode],
    layout: FeatureLayout,
    *,
    policy: str,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> DmpModel:
    """Learn one primitive from what the holder did while placing; what came after a disturbance is no part of it.

    Each demonstration has a start, an end and a duration of its own; the weights are common to all. Positions are
    linear in the weights, so that these follow from least squares on positions; nothing is differentiated twice.
    """
    taught = build_training_set(episodes, layout)
    ways = [_way(episode, layout) for episode in episodes]
    step_s = taught.episodes[0].step_s
    goal, weights, duration_s = _learned(ways, step_s)
    if progress is not None:
        progress(1, 1, f"{len(ways)} ways of {duration_s:.1f} s on average")
    return DmpModel(
        **taught.shared(policy, seed, provenance),
        goal=goal,
        weights=weights,
        duration_s=duration_s,
        heldout_rmse_m=_held_out(episodes, ways, step_s),
    )


def _way(episode: Episode, layout: FeatureLayout) -> FloatArray:
    """(T + 1, A) m: where the holder was before each step of placing, and after the last."""
    placed = [step for step in episode.steps if step.phase == "place"]
    if len(placed) < 2:
        raise PolicyError(
            f"the demonstration of seed {episode.seed} holds {len(placed)} steps of placing; 2 are needed"
        )
    after = [step.observation for step in episode.steps[len(placed) :]] or [episode.final_observation]
    return np.vstack([layout.matrix(placed), layout.vector(after[0])])


def _learned(ways: Sequence[FloatArray], step_s: float) -> tuple[FloatArray, FloatArray, float]:
    """Goal, weights and duration of what these ways have in common."""
    axes = ways[0].shape[1]
    responses, rests = [], []
    for way in ways:
        steps = len(way) - 1
        free = path(way[0], way[-1], np.zeros((axes, BASIS)), step_u=1 / steps, steps=steps)
        # How an axis at rest answers to each basis function alone.
        still = np.zeros(BASIS)
        responses.append(path(still, still, np.eye(BASIS), step_u=1 / steps, steps=steps))
        rests.append(way - free)
    response, rest = np.vstack(responses), np.vstack(rests)
    gram = response.T @ response
    gram[np.diag_indices(BASIS)] += RIDGE * np.trace(gram) / BASIS
    # In rows, as a file gives it back: sums of a transposed array differ in the last bit.
    weights: FloatArray = np.ascontiguousarray(np.linalg.solve(gram, response.T @ rest).T)
    goal = np.mean([way[-1] for way in ways], axis=0)
    return goal, weights, step_s * float(np.mean([len(way) - 1 for way in ways]))


def _held_out(episodes: Sequence[Episode], ways: Sequence[FloatArray], step_s: float) -> tuple[float, ...] | None:
    """(A,) m per step: error of the moves from a demonstration's own start, by a primitive learned from the others."""
    if len(ways) < 2:
        return None
    errors = []
    for k, (episode, way) in enumerate(zip(episodes, ways, strict=True)):
        goal, weights, duration_s = _learned([*ways[:k], *ways[k + 1 :]], step_s)
        steps = len(way) - 1
        moved = np.diff(path(way[0], goal, weights, step_u=step_s / duration_s, steps=steps), axis=0)
        errors.append(actions_of(episode.steps[:steps]) - moved)
    return tuple(float(value) for value in np.sqrt((np.vstack(errors) ** 2).mean(axis=0)))
