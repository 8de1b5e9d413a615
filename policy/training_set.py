"""Demonstrations as columns, the training sets that learners fit, and the error on demonstrations left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from platform import python_version
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.cloth_frame import SIZE_FACTOR, SIZE_KEYS, ClothFrame
from layflat.data.format.content import content_of_episode, copies_among, repeated_steps
from layflat.data.robot import RobotSpec
from layflat.data.session.reader import Session
from layflat.data.types import Episode, Provenance
from layflat.policy.base import PolicyError
from layflat.policy.features import (
    CLOTH,
    WORLD,
    FeatureLayout,
    Frame,
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
SizeOf: TypeAlias = Callable[[str, Mapping[str, Any]], ClothFrame | None]
"""Returns the size of a cloth, by its name and the settings of its simulation; None where it is not known."""

Predict = Callable[[FloatArray], FloatArray]
"""(M, D) inputs in natural units -> (M, A) m per step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstrations:
    """Steps of whole demonstrations of one robot, task, step and descriptor; T steps of E demonstrations.

    A demonstration that is there twice by its content is taken once. Cloths may differ where their sizes are known.
    """

    robot: RobotSpec
    task: str
    cloth: str
    """Cloth of the first."""
    descriptor: str
    step_s: float
    seeds: tuple[int, ...]
    """Seed of each demonstration."""
    starts: tuple[str, ...]
    """Name of each demonstration's start, such as hanging; empty where it is not known."""
    sizes: tuple[ClothFrame | None, ...]
    """Size of each demonstration's cloth; None where it is not known."""
    cloths: tuple[str, ...]
    """Name of each demonstration's cloth."""
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
    def from_session(cls, session: Session, names: Sequence[str], size_of: SizeOf | None = None) -> Demonstrations:
        """Read the episodes with these names; no step or observation objects are made."""
        size_of = size_of or recorded_size
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
            sizes=tuple(size_of(session.cloth, session.settings(name)) for name in names),
            cloths=(session.cloth,) * len(names),
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
            sized = recorded_size(episode.cloth, episode.sim_config) and recorded_size(first.cloth, first.sim_config)
            for attribute, noun in _AGREED.items():
                found, wanted = getattr(episode, attribute), getattr(first, attribute)
                if found != wanted and not (attribute == "cloth" and sized):
                    raise PolicyError(f"demonstrations mix {noun} {wanted} and {found}; choose one")
        copies = copies_among({str(k): content_of_episode(episode) for k, episode in enumerate(episodes)})
        episodes = [episode for k, episode in enumerate(episodes) if str(k) not in copies]
        steps = [step for episode in episodes for step in episode.steps]
        after = [observation for episode in episodes for observation in episode.observations()[1:]]
        return cls(
            **_shared(first),
            seeds=tuple(episode.seed for episode in episodes),
            starts=tuple(str(episode.sim_config.get("start", "")) for episode in episodes),
            sizes=tuple(recorded_size(episode.cloth, episode.sim_config) for episode in episodes),
            cloths=tuple(episode.cloth for episode in episodes),
            observations=observation_columns([step.observation for step in steps], observation_keys(first.robot)),
            next_positions=observation_columns(after, (position_key(first.robot),)),
            actions=np.array([step.action for step in steps]).reshape(len(steps), first.robot.size),
            phases=np.array([step.phase.encode() for step in steps], dtype="|S8"),
            interventions=np.array([step.intervention for step in steps], dtype=bool),
            numbers=np.repeat(np.arange(len(episodes)), [len(episode.steps) for episode in episodes]),
        )

    @classmethod
    def joined(cls, parts: Sequence[Demonstrations]) -> Demonstrations:
        """Return the demonstrations of several sessions as one set; PolicyError where they do not belong together."""
        first, *rest = parts
        for other in rest:
            for name, noun in {"robot": "robots", **_AGREED}.items():
                found, wanted = getattr(other, name), getattr(first, name)
                if found != wanted and not (name == "cloth" and None not in (*first.sizes, *other.sizes)):
                    raise PolicyError(f"demonstrations mix {noun} {wanted} and {found}; choose one")
        before = np.cumsum([0, *(len(part) for part in parts)])
        values: dict[str, Any] = {name: sum((getattr(part, name) for part in parts), ()) for name in _PER_DEMONSTRATION}
        values |= {name: np.concatenate([getattr(part, name) for part in parts]) for name in _PER_STEP}
        values |= {
            name: {key: np.concatenate([getattr(part, name)[key] for part in parts]) for key in getattr(first, name)}
            for name in ("observations", "next_positions")
        }
        numbers = np.concatenate([part.numbers + start for part, start in zip(parts, before, strict=False)])
        return replace(first, **values, numbers=numbers)

    def in_cloth_frame(self) -> Demonstrations:
        """Return the same steps as if every cloth were as large as the towel; every size must be known."""
        if all(size is not None and size.is_world for size in self.sizes):
            return self
        points, key = self.robot.n_points, position_key(self.robot)
        seen, after, actions = dict(self.observations), dict(self.next_positions), self.actions.copy()
        seen[key], after[key] = seen[key].copy(), after[key].copy()
        for number, size in enumerate(self.sizes):
            rows = self.numbers == number
            if size is None:
                raise PolicyError(f"the size of cloth {self.cloths[number]} is not known; train with --frame world")
            at = seen[key][rows].reshape(-1, points, 3)
            slopes = np.array([self.robot.pack(slope) for slope in size.slopes(at)])
            actions[rows] *= slopes.reshape(actions[rows].shape)
            seen[key][rows] = size.held(at).reshape(-1, 3 * points)
            after[key][rows] = size.held(after[key][rows].reshape(-1, points, 3)).reshape(-1, 3 * points)
        return replace(self, observations=seen, next_positions=after, actions=actions)


_PER_DEMONSTRATION = ("seeds", "starts", "sizes", "cloths")
_PER_STEP = ("actions", "phases", "interventions")


def recorded_size(cloth: str, settings: Mapping[str, Any]) -> ClothFrame | None:
    """Return the size of an episode's cloth by the settings of its simulation; None where they do not say it."""
    length, width = (settings.get(key) for key in SIZE_KEYS)
    known = isinstance(length, float) and isinstance(width, float) and 0.01 < length < 10.0 and 0.01 < width < 10.0
    factor = settings.get(SIZE_FACTOR, 1.0)
    if not known or not isinstance(factor, float) or not 0.1 < factor < 10.0:
        return None
    return ClothFrame(length_m=factor * float(length), width_m=factor * float(width))  # type: ignore[arg-type]


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
            "cloths": tuple(
                dict.fromkeys(
                    (name, size.length_m, size.width_m)
                    for name, size in zip(self.demonstrations.cloths, self.demonstrations.sizes, strict=True)
                    if size is not None
                )
            ),
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
    frame: Frame | None = None,
    seed: int = 0,
    provenance: Provenance | None = None,
) -> TrainingSet:
    """Return all steps but those of phase ``disturb``, each once, with a named input set.

    ``frame`` None is the cloth's where every cloth's size is known, else the world's.

    The caller chooses which episodes are worth learning from (no failures, no folds). PolicyError where the steps are
    too few or the demonstrations do not belong together.
    """
    known = source if isinstance(source, Demonstrations) else Demonstrations.from_episodes(source)
    if frame is None:
        frame = WORLD if None in known.sizes else CLOTH
    if frame == CLOTH:
        known = known.in_cloth_frame()
    elif len(set(known.cloths)) > 1:
        raise PolicyError(f"demonstrations mix the cloths {' and '.join(sorted(set(known.cloths)))}; choose one")
    layout = input_set(known.robot, inputs, frame)
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
