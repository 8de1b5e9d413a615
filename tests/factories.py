"""Values that the tests of several packages share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from layflat.data import SessionRecorder
from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, STEP_S, Episode, GroundTruth, Observation, Provenance, Step
from layflat.sim.robots.registry import ROBOTS, robot_spec

HANGER = robot_spec("hanger")
PICKERS = robot_spec("pickers")
ROBOT_SPECS = tuple(robot_spec(name) for name in ROBOTS)


def _observation(rng: np.random.Generator, time_s: float, portion: float, images: bool) -> Observation:
    angle = rng.uniform(-np.pi / 2, np.pi / 2)
    corners = rng.uniform(-0.3, 0.6, (2, 3))
    return Observation(
        time_s=time_s,
        corner_positions=corners,
        holder_position=corners.mean(axis=0),
        word=[np.cos(angle), np.sin(angle)],
        word_strength=rng.uniform(0, 1),
        contact_portion=portion,
        rgb=rng.integers(0, 256, (6, 8, 3), dtype=np.uint8) if images else None,
        depth=rng.uniform(0.3, 1.2, (6, 8)).astype(np.float32) if images else None,
    )


def make_episode(
    robot: str | RobotSpec = "hanger",
    n_steps: int = 5,
    seed: int = 0,
    images: bool = False,
    nodes: int = 12,
    with_std: bool = False,
    **overrides: Any,
) -> Episode:
    """Make an episode of valid random values without physics; the contact portion rises evenly from 0 to 0.97."""
    rng = np.random.default_rng(seed)
    spec = robot if isinstance(robot, RobotSpec) else robot_spec(robot)
    size = spec.size
    portions = np.linspace(0.0, 0.97, n_steps + 1)
    observations = [_observation(rng, i * STEP_S, float(p), images) for i, p in enumerate(portions)]
    ground_truths = [
        GroundTruth(nodes=rng.normal(0, 0.2, (nodes, 3)), contact_portion_true=float(p), flat_area=float(p) - 0.01)
        for p in portions
    ]
    steps = [
        Step(
            observation=observations[i],
            ground_truth=ground_truths[i],
            action=rng.uniform(-ACTION_LIMIT_M, ACTION_LIMIT_M, size),
            action_std=rng.uniform(0, 0.01, size) if with_std else None,
        )
        for i in range(n_steps)
    ]
    values: dict[str, Any] = {
        "robot": spec,
        "cloth": "towel",
        "seed": seed,
        "source": "scripted",
        "steps": steps,
        "final_observation": observations[-1],
        "final_ground_truth": ground_truths[-1],
        "stopped_by": "converged",
        "outcome": "success",
        "wall_s": 1.25,
        "start": {"friction": 0.5, "mass": 0.061},
        "provenance": Provenance(versions={"layflat": "0.1.0"}, platform="test", created_utc="2024-01-01T00:00:00Z"),
    }
    return Episode(**(values | overrides))


def without_ground_truth(episode: Episode) -> Episode:
    """Return the episode as a real robot would have recorded it."""
    steps = [replace(step, ground_truth=None) for step in episode.steps]
    return replace(episode, steps=steps, final_ground_truth=None, physics="real")


def initial_of(episode: Episode) -> Episode:
    """Return what is known of an episode before its first step."""
    first = episode.steps[0]
    return replace(
        episode,
        steps=(),
        final_observation=first.observation,
        final_ground_truth=first.ground_truth,
        outcome="partial",
        stopped_by="interrupted",
    )


def prefix_of(episode: Episode, n_steps: int, **changes: Any) -> Episode:
    """Return what a recording that was cut off after these steps may hold; an independent check of the product."""
    after = [*episode.steps, None][n_steps]
    observation = episode.final_observation if after is None else after.observation
    ground_truth = episode.final_ground_truth if after is None else after.ground_truth
    values: dict[str, Any] = {"outcome": "partial", "stopped_by": "crashed"} | changes
    steps = episode.steps[:n_steps]
    return replace(episode, steps=steps, final_observation=observation, final_ground_truth=ground_truth, **values)


def write_session(path: Path, episodes: Sequence[Episode], **options: Any) -> Path:
    """Record these episodes, images included, to a finished session; ``options`` are the recorder's."""
    first = episodes[0]
    values = {"robot": first.robot, "cloth": first.cloth, "save_images": True} | options
    with SessionRecorder(path, **values) as recorder:
        for episode in episodes:
            recorder.save(episode)
    return path


def differences(a: Any, b: Any, where: str = "") -> list[str]:
    """Return where two values of layflat.data.types differ, arrays bit by bit; empty where they are equal."""
    where = where or type(a).__name__
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        same = type(a) is type(b) and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
        return [] if same else [where]
    if is_dataclass(a) and type(a) is type(b):
        return [d for f in fields(a) for d in differences(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")]
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return [d for i, (x, y) in enumerate(zip(a, b, strict=True)) for d in differences(x, y, f"{where}[{i}]")]
    return [] if a == b else [f"{where}: {a!r} != {b!r}"]
