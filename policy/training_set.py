"""Demonstrations as columns, the training sets that learners fit, and the error on demonstrations left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from platform import python_version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.format.content import content_of_episode, copies_among, repeated_steps
from layflat.data.robot import RobotSpec
from layflat.data.session.reader import Session
from layflat.data.types import Episode, Provenance
from layflat.policy.base import PolicyError
from layflat.policy.features import (
    FeatureLayout,
    ObservationColumns,
    input_set,
    observation_columns,
    observation_keys,
    position_key,
)

OUTPUT_SCALE_M = 0.01
"""Usual move in one step, to which learners' bounds are relative. A constant, so that no data set changes a prior."""
MIN_POINTS = 10
_AGREED = {"task": "the tasks", "cloth": "the cloths", "step_s": "steps of", "descriptor": "the descriptors"}

Predict = Callable[[FloatArray], FloatArray]
"""(M, D) inputs in natural units -> (M, A) m per step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstrations:
    """Steps of whole demonstrations of one robot, task, cloth, step and descriptor; T steps of E demonstrations.

    A demonstration that is there twice by its content is taken once.
    """

    robot: RobotSpec
    task: str
    cloth: str
    descriptor: str
    step_s: float
    seeds: tuple[int, ...]
    """Seed of each demonstration."""
    starts: tuple[str, ...]
    """Name of each demonstration's start, such as hanging; empty where it is not known."""
    observations: ObservationColumns
    """Rows (T, ...) before each step."""
    next_positions: ObservationColumns
    """Rows (T, ...) of the robot's positions after each step."""
    actions: FloatArray
    """(T, A) m per step."""
    phases: NDArray[np.bytes_]
    """(T,) ``place``, ``disturb`` or ``repair``."""
    interventions: NDArray[np.bool_]
    """(T,) true where a person decided although a policy was in control."""
    numbers: NDArray[np.int64]
    """(T,) position of the step's demonstration in ``seeds``."""
    recordings: tuple[int, ...] = field(init=False)
    """Position of the first demonstration with which each one shares steps, such as a trimmed copy; else its own."""
    repeated: NDArray[np.bool_] = field(init=False)
    """(T,) true where an earlier demonstration of that recording has the same step."""

    def __post_init__(self) -> None:
        columns = [*self.observations.values(), self.actions]
        rows = [self.numbers == number for number in range(len(self))]
        recordings, repeats = repeated_steps(self.seeds, lambda number: [column[rows[number]] for column in columns])
        repeated = np.zeros(len(self.actions), dtype=bool)
        for number, there in repeats.items():
            repeated[rows[number]] = there
        object.__setattr__(self, "recordings", tuple(recordings))
        object.__setattr__(self, "repeated", repeated)

    def __len__(self) -> int:
        return len(self.seeds)

    @classmethod
    def from_session(cls, session: Session, names: Sequence[str]) -> Demonstrations:
        """Read the episodes with these names; no step or observation objects are made."""
        _check_any(names)
        copies = session.copies(names)
        names = [name for name in names if name not in copies]
        keys, position = observation_keys(session.robot), position_key(session.robot)
        rows = session.arrays(
            [*(f"obs/{key}" for key in keys), f"next_obs/{position}", "action_m", "phase", "intervention"], names
        )
        return cls(
            **_shared(session),
            seeds=tuple(session.info(name).seed for name in names),
            starts=tuple(str(session.settings(name).get("start", "")) for name in names),
            observations={key: rows[f"obs/{key}"] for key in keys},
            next_positions={position: rows[f"next_obs/{position}"]},
            actions=rows["action_m"],
            phases=rows["phase"],
            interventions=rows["intervention"].astype(bool),
            numbers=rows["episode"],
        )

    @classmethod
    def from_episodes(cls, episodes: Sequence[Episode]) -> Demonstrations:
        """Take the steps of episodes; PolicyError where they do not belong together."""
        _check_any(episodes)
        first = episodes[0]
        for number, episode in enumerate(episodes):
            if episode.robot != first.robot:
                raise PolicyError(f"demonstration {number} is of robot {episode.robot}; the first is of {first.robot}")
            for attribute, noun in _AGREED.items():
                found, wanted = getattr(episode, attribute), getattr(first, attribute)
                if found != wanted:
                    raise PolicyError(f"demonstrations mix {noun} {wanted} and {found}; choose one")
        copies = copies_among({str(k): content_of_episode(episode) for k, episode in enumerate(episodes)})
        episodes = [episode for k, episode in enumerate(episodes) if str(k) not in copies]
        steps = [step for episode in episodes for step in episode.steps]
        after = [observation for episode in episodes for observation in episode.observations()[1:]]
        return cls(
            **_shared(first),
            seeds=tuple(episode.seed for episode in episodes),
            starts=tuple(str(episode.sim_config.get("start", "")) for episode in episodes),
            observations=observation_columns([step.observation for step in steps], observation_keys(first.robot)),
            next_positions=observation_columns(after, (position_key(first.robot),)),
            actions=np.array([step.action for step in steps]).reshape(len(steps), first.robot.size),
            phases=np.array([step.phase.encode() for step in steps], dtype="|S8"),
            interventions=np.array([step.intervention for step in steps], dtype=bool),
            numbers=np.repeat(np.arange(len(episodes)), [len(episode.steps) for episode in episodes]),
        )


def _shared(source: Session | Episode) -> dict[str, Any]:
    return {"robot": source.robot} | {name: getattr(source, name) for name in _AGREED}


def _check_any(demonstrations: Sequence[object]) -> None:
    if not demonstrations:
        raise PolicyError("there are no demonstrations to learn from; at least one is needed")


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingSet:
    """Inputs and targets of the steps of demonstrations, without the phase ``disturb``; arrays read-only."""

    policy: str
    """Name of the policy that is trained."""
    layout: FeatureLayout
    seed: int
    provenance: Provenance
    demonstrations: Demonstrations
    inputs: FloatArray
    """(N, D) in natural units."""
    targets: FloatArray
    """(N, A) m per step."""
    groups: NDArray[np.int64]
    """(N,) number of the step's recording: a demonstration, or several that share steps."""
    corrections: NDArray[np.bool_]
    """(N,) true where a person decided although a policy was in control."""

    def shared(self, *libraries: str) -> dict[str, Any]:
        """Return the fields of a TrainedModel that do not depend on its method; the fit used ``libraries``."""
        # The numbers of a fit depend on these, where the caller has not named them.
        own = {"python": python_version(), "numpy": np.__version__} | {name: version(name) for name in libraries}
        return {
            **{name: getattr(self, name) for name in ("policy", "layout", "seed")},
            **{name: getattr(self.demonstrations, name) for name in _AGREED},
            "demonstrations": len(self.demonstrations),
            "taught": tuple(zip(self.demonstrations.starts, self.demonstrations.seeds, strict=True)),
            "points_available": len(self.inputs),
            "provenance": replace(self.provenance, versions={**own, **self.provenance.versions}),
        }


def build_training_set(
    source: Demonstrations | Sequence[Episode],
    inputs: str,
    *,
    policy: str,
    seed: int = 0,
    provenance: Provenance | None = None,
) -> TrainingSet:
    """Return all steps but those of phase ``disturb``, each once, with a named input set.

    The caller chooses which episodes are worth learning from (no failures, no folds). PolicyError where the steps are
    too few or the demonstrations do not belong together.
    """
    known = source if isinstance(source, Demonstrations) else Demonstrations.from_episodes(source)
    layout = input_set(known.robot, inputs)
    rows = (known.phases != b"disturb") & ~known.repeated
    count = int(rows.sum())
    if count < MIN_POINTS:
        raise PolicyError(f"the demonstrations hold {count} steps; at least {MIN_POINTS} are needed")
    return TrainingSet(
        policy=policy,
        layout=layout,
        seed=seed,
        provenance=provenance or Provenance(),
        demonstrations=known,
        inputs=frozen_array(layout.select(known.observations)[rows], (count, layout.size), "inputs"),
        targets=frozen_array(known.actions[rows], (count, layout.robot.size), "targets"),
        groups=np.array(known.recordings)[known.numbers[rows]],
        corrections=known.interventions[rows],
    )


def held_out_rmse(training: TrainingSet, fit: Callable[[FloatArray, FloatArray], Predict]) -> tuple[float, ...] | None:
    """Return (A,) m per step: error on each recording of a fit to the others; None where there are no others."""
    labels = np.unique(training.groups)
    if len(labels) < 2:
        return None
    errors = np.empty_like(training.targets)
    for label in labels:
        out = training.groups == label
        errors[out] = training.targets[out] - fit(training.inputs[~out], training.targets[~out])(training.inputs[out])
    return rmse(errors)


def rmse(errors: FloatArray) -> tuple[float, ...]:
    """Return the root mean square of each column of errors (N, A)."""
    return tuple(float(value) for value in np.sqrt((errors**2).mean(axis=0)))
