"""Fixtures that the tests of several packages share."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, STEP_S, Episode, GroundTruth, Observation, Provenance, Step
from layflat.sim.robots.registry import robot_spec

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell that starts the tests in its background has them ignore Ctrl-C, and with them what they start.
    signal.signal(signal.SIGINT, signal.default_int_handler)


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


def _build_episode(
    robot: str | RobotSpec = "hanger",
    n_steps: int = 5,
    seed: int = 0,
    images: bool = False,
    nodes: int = 12,
    with_std: bool = False,
    **overrides: Any,
) -> Episode:
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


@pytest.fixture(scope="session")
def make_episode() -> Callable[..., Episode]:
    """``make_episode(robot="hanger", steps=5, seed=0, images=False, nodes=12, with_std=False, **fields of Episode)``.

    Valid random values without physics; the contact portion rises evenly from 0 to 0.97.
    """
    return _build_episode


def _differences(a: Any, b: Any, where: str) -> list[str]:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        same = type(a) is type(b) and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
        return [] if same else [where]
    if is_dataclass(a) and type(a) is type(b):
        return [d for f in fields(a) for d in _differences(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")]
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return [d for i, (x, y) in enumerate(zip(a, b, strict=True)) for d in _differences(x, y, f"{where}[{i}]")]
    return [] if a == b else [f"{where}: {a!r} != {b!r}"]


@pytest.fixture(scope="session")
def differences() -> Callable[[Any, Any], list[str]]:
    """``differences(a, b)``: where two values of layflat.data.types differ, arrays bit by bit; empty where they are
    equal."""
    return lambda a, b: _differences(a, b, type(a).__name__)
