"""Demonstrations as columns: the steps of several episodes one after another, straight from a session's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.session.reader import Session
from layflat.data.types import Episode
from layflat.policy.base import PolicyError
from layflat.policy.features import ObservationColumns, observation_columns, observation_keys, position_key

_AGREED = {"task": "the tasks", "cloth": "the cloths", "step_s": "steps of", "descriptor": "the descriptors"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstrations:
    """Steps of whole demonstrations of one robot, task, cloth, step and descriptor; T steps of E demonstrations."""

    robot: RobotSpec
    task: str
    cloth: str
    descriptor: str
    step_s: float
    seeds: tuple[int, ...]
    """Seed of each demonstration."""
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

    def __len__(self) -> int:
        return len(self.seeds)

    @classmethod
    def from_session(cls, session: Session, names: Sequence[str]) -> Demonstrations:
        """Read the episodes with these names; no step or observation objects are made."""
        _check_any(names)
        keys, position = observation_keys(session.robot), position_key(session.robot)
        rows = session.arrays(
            [*(f"obs/{key}" for key in keys), f"next_obs/{position}", "action_m", "phase", "intervention"], names
        )
        return cls(
            robot=session.robot,
            task=session.task,
            cloth=session.cloth,
            descriptor=session.descriptor,
            step_s=session.step_s,
            seeds=tuple(session.info(name).seed for name in names),
            observations={key: rows[f"obs/{key}"] for key in keys},
            next_positions={position: rows[f"next_obs/{position}"]},
            actions=rows["action_m"],
            phases=rows["phase"],
            interventions=rows["intervention"].astype(bool),
            numbers=rows["episode"],
        )

    @classmethod
    def of(cls, source: Demonstrations | Sequence[Episode]) -> Demonstrations:
        """Return demonstrations as they are, and those of episodes."""
        return source if isinstance(source, Demonstrations) else cls.from_episodes(source)

    @classmethod
    def from_episodes(cls, episodes: Sequence[Episode]) -> Demonstrations:
        """Take the steps of episodes; PolicyError where they do not belong together."""
        _check_any(episodes)
        first, steps = episodes[0], [step for episode in episodes for step in episode.steps]
        for number, episode in enumerate(episodes):
            if episode.robot != first.robot:
                raise PolicyError(f"demonstration {number} is of robot {episode.robot}; the first is of {first.robot}")
            for attribute, noun in _AGREED.items():
                found, wanted = getattr(episode, attribute), getattr(first, attribute)
                if found != wanted:
                    raise PolicyError(f"demonstrations mix {noun} {wanted} and {found}; choose one")
        after = [observation for episode in episodes for observation in episode.observations()[1:]]
        position = position_key(first.robot)
        return cls(
            robot=first.robot,
            task=first.task,
            cloth=first.cloth,
            descriptor=first.descriptor,
            step_s=first.step_s,
            seeds=tuple(episode.seed for episode in episodes),
            observations=observation_columns([step.observation for step in steps], observation_keys(first.robot)),
            next_positions=observation_columns(after, (position,)),
            actions=np.array([step.action for step in steps]).reshape(len(steps), first.robot.size),
            phases=np.array([step.phase.encode() for step in steps], dtype="|S8"),
            interventions=np.array([step.intervention for step in steps], dtype=bool),
            numbers=np.repeat(np.arange(len(episodes)), [len(episode.steps) for episode in episodes]),
        )


def _check_any(demonstrations: Sequence[object]) -> None:
    if not demonstrations:
        raise PolicyError("there are no demonstrations to learn from; at least one is needed")
