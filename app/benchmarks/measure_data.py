"""Speed of recording and reading sessions; each function runs once in a fresh process.

Sizes count the bytes of an episode's arrays as they are in memory; MB are 10^6 bytes.
"""

from __future__ import annotations

import os
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.app.benchmarks.measure import DRAG_STEP_M, SEED, lay_down, lengthened
from layflat.app.benchmarks.rows import BenchmarkRow, Samples
from layflat.data.arrays import FloatArray
from layflat.data.atomic_files import fsync_path
from layflat.data.format.encode import LIBVER, arrays_of, attributes_of
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import EpisodeWriter, SessionRecorder
from layflat.data.session.session_writer import SessionFile
from layflat.data.types import ACTION_LIMIT_M, Episode, GroundTruth, Observation, Step
from layflat.policy.rollout import run_until_stop
from layflat.policy.runner import EpisodeRunner
from layflat.policy.scripted.baselines import DragPolicy
from layflat.policy.stopping import AnyOf
from layflat.policy.training_set import Demonstrations
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import robot_spec
from layflat.sim.simulation import ClothSimulation

ROBOT = "pickers"
CLOTH = DEFAULT_CLOTH
STEPS = 24
REPEATS = 5
EPISODES = 1000
"""Number of episodes in the session whose opening is timed."""
READ = 100
"""Number of its episodes that are read."""
SHARE_GOAL = 2.0
"""Share of a step, in percent, that recording may cost on the thread that controls."""
OPEN_GOAL_S = 2.0
"""Wall time of opening 10,000 episodes."""
COMPRESSIONS: Mapping[str, Mapping[str, object]] = {
    "none": {},
    "lzf": {"compression": "lzf"},
    "gzip 1": {"compression": "gzip", "compression_opts": 1},
    "gzip 4": {"compression": "gzip", "compression_opts": 4},
}


@dataclass
class _Timed:
    """A callback that times another one."""

    running: EpisodeWriter
    walls_s: list[float] = field(default_factory=list)

    def on_step(self, step: Step, step_index: int) -> None:
        began = time.perf_counter()
        self.running.on_step(step, step_index)
        self.walls_s.append(time.perf_counter() - began)


def recording(folder: Path | None = None, n_steps: int = STEPS) -> dict[str, FloatArray]:
    """Measure an episode of 320x240 RGB-D that is recorded while the cloth is dragged.

    Wall s per step: ``step`` (all of it), ``hand over`` (recording, on the loop's thread), ``journal`` (processor time
    of both threads). MB/s: ``keep`` (durable) and ``raw`` (h5py, one file, no packing, flushed to the disk). MB:
    ``size``, and by packing ``size none|lzf|gzip 1|gzip 4``; processor s of packing ``pack none|...``.
    """
    with _place(folder) as place:
        with SessionRecorder(place / "s.h5", robot=robot_spec(ROBOT), cloth=CLOTH, save_images=True) as recorder:
            samples, episode = _record(recorder, n_steps)
            samples["journal"] = np.array([_journal_alone(recorder, episode) for _ in range(REPEATS)])
            episode = lengthened(episode)
            arrays = arrays_of(episode, save_images=True)
            megabytes = sum(array.nbytes for array in arrays.values()) / 1e6
            keep, raw = [], []
            for _ in range(REPEATS):
                keep.append(megabytes / _wall(lambda: recorder.save(episode)))
                raw.append(megabytes / _wall(lambda: _raw(place / "raw.h5", arrays)))
        images = {key: rows for key, rows in arrays.items() if rows.ndim == 4}
        for name, packing in COMPRESSIONS.items():
            samples |= _packed(place / "packed.h5", images, name, packing)
        return samples | {"keep": np.array(keep), "raw": np.array(raw), "size": np.array([megabytes])}


def opening(folder: Path | None = None, episodes: int = EPISODES) -> dict[str, FloatArray]:
    """Measure a session of made-up episodes without images, of 84 steps and 285 nodes.

    Wall s: ``open`` (all that info needs), ``read`` (one episode), ``columns`` (one episode's columns for
    training). MB: ``growth`` of the process while READ episodes are read one after another.
    """
    episode = _made_up(n_steps=84, nodes=285)
    with _place(folder) as place:
        path = place / "s.h5"
        write_copies(path, episode, episodes)
        opened = [_wall(lambda: open_session(path).close()) for _ in range(REPEATS)]
        with open_session(path) as session:
            names = session.names[:READ]
            walls = [_wall(partial(session.episode, name)) for name in names[: READ // 2]]
            before = resident_mb()
            walls += [_wall(partial(session.episode, name)) for name in names[READ // 2 :]]
            growth = resident_mb() - before
        with open_session(path) as session:
            columns = [_wall(partial(Demonstrations.from_session, session, [name])) for name in names]
    return {
        "open": np.array(opened),
        "read": np.array(walls),
        "columns": np.array(columns),
        "growth": np.array([growth]),
        "episodes": np.array([float(episodes)]),
    }


def write_copies(path: Path, episode: Episode, count: int) -> None:
    """Write a session of copies of one episode, each with a uid of its own."""
    arrays = arrays_of(episode, save_images=True)
    with h5py.File(path, "x", libver=LIBVER) as file:
        session = SessionFile(file)
        for number in range(count):
            session.write(f"demo_{number}", attributes_of(episode, uuid.uuid4().hex), arrays)
        session.finish()


def resident_mb() -> float:
    """Return the resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def recording_rows(samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return the cost of recording, its speed, and how small and how fast each compression packs images."""
    middle = {key: float(np.median(values)) for key, values in samples.items()}
    share, cpu = (100 * middle[key] / middle["step"] for key in ("hand over", "journal"))
    rows = [
        _row("recording, loop's thread", share, "% of a step", SHARE_GOAL, len(samples["hand over"])),
        _row("recording, both threads", cpu, "% of a step", None, REPEATS),
        _row("keep, images, durable", middle["keep"], "MB / s", middle["raw"], REPEATS),
    ]
    for name in list(COMPRESSIONS)[1:]:
        times = [1e3 * middle[f"pack {key}"] for key in (name, "none")]
        rows.append(_row(f"images packed by {name}", middle[f"size {name}"], "MB", middle["size none"]))
        rows.append(_row(f"time to pack by {name}", times[0], "ms", times[1]))
    return rows


def opening_rows(samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return the time of opening and reading a large session, and the growth of memory."""
    middle = {key: float(np.median(values)) for key, values in samples.items()}
    count = middle["episodes"]
    return [
        _row(f"open {count:.0f} episodes", 1e3 * middle["open"], "ms", OPEN_GOAL_S * 1e3 * count / 1e4, REPEATS),
        _row("read an episode without images", 1e3 * middle["read"], "ms", None, READ),
        _row("read an episode's columns for training", 1e3 * middle["columns"], "ms", 1e3 * middle["read"], READ),
        _row("memory while reading", middle["growth"], "MB", None),
    ]


def _row(name: str, value: float, unit: str, baseline: float | None, samples: int = 1) -> BenchmarkRow:
    return BenchmarkRow(name=name, value=value, unit=unit, baseline=baseline, samples=samples)


def _record(recorder: SessionRecorder, n_steps: int) -> tuple[dict[str, FloatArray], Episode]:
    env = ClothSimulation(SimConfig(robot=ROBOT, cloth=CLOTH))
    timed: list[_Timed] = []

    def begin(beginning: Episode) -> _Timed:
        timed.append(_Timed(recorder.start(beginning)))
        return timed[0]

    try:
        env.reset(SEED)
        lay_down(env)
        policy = DragPolicy(robot_spec(ROBOT), name="drag", stop=AnyOf(), speed_m=DRAG_STEP_M)
        began = time.perf_counter()
        run = EpisodeRunner(env, policy, seed=SEED, keep_images=True, on_start=begin)
        episode = run.build_episode(run_until_stop(run, max_steps=n_steps))
        wall_s = time.perf_counter() - began
    finally:
        env.close()
    timed[0].running.discard()
    return {"step": np.array([wall_s / n_steps]), "hand over": np.array(timed[0].walls_s)}, episode


def _journal_alone(recorder: SessionRecorder, episode: Episode) -> float:
    """Return the processor time per step of handing over, packing, writing and flushing, s."""
    running = recorder.start(episode)
    began = time.process_time()
    for step in episode.steps:
        running.step(step)
    running.close()
    spent = time.process_time() - began
    running.discard()
    return spent / len(episode.steps)


def _raw(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    with h5py.File(path, "w") as file:
        for key, rows in arrays.items():
            file.create_dataset(key, data=rows)
    fsync_path(path)


def _packed(
    path: Path, images: dict[str, NDArray[Any]], name: str, packing: Mapping[str, object]
) -> dict[str, FloatArray]:
    began = time.process_time()
    with h5py.File(path, "w") as file:
        for key, rows in images.items():
            file.create_dataset(key, data=rows, chunks=(1, *rows.shape[1:]), fletcher32=True, **packing)
    spent_s = time.process_time() - began
    return {f"pack {name}": np.array([spent_s]), f"size {name}": np.array([path.stat().st_size / 1e6])}


def _made_up(*, n_steps: int, nodes: int) -> Episode:
    """Return an episode with the shapes of a real one, without physics."""
    rng = np.random.default_rng(SEED)

    def observation(step_index: int) -> Observation:
        corners = rng.uniform(-0.3, 0.6, (2, 3))
        return Observation(
            time_s=0.1 * step_index,
            corner_positions=corners,
            holder_position=corners.mean(axis=0),
            word=np.array([1.0, 0.0]),
            word_strength=0.1,
            contact_portion=step_index / n_steps,
        )

    def ground_truth(step_index: int) -> GroundTruth:
        return GroundTruth(
            nodes=rng.normal(0, 0.2, (nodes, 3)),
            contact_portion_true=step_index / n_steps,
            flat_area=step_index / n_steps,
        )

    steps = [
        Step(
            observation=observation(step_index),
            ground_truth=ground_truth(step_index),
            action=rng.uniform(-ACTION_LIMIT_M, ACTION_LIMIT_M, robot_spec(ROBOT).size),
        )
        for step_index in range(n_steps)
    ]
    return Episode(
        robot=robot_spec(ROBOT),
        cloth=CLOTH,
        seed=SEED,
        source="scripted",
        steps=tuple(steps),
        final_observation=observation(n_steps),
        final_ground_truth=ground_truth(n_steps),
        stopped_by="converged",
        outcome="success",
    )


def _wall(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


@contextmanager
def _place(folder: Path | None) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix=".layflat-bench-", dir=folder) as place:
        yield Path(place)
