"""Demonstrations and models of a reproduction: made once, when something needs them, and used again."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from contextlib import redirect_stdout
from pathlib import Path

from layflat.app.commands.record import keep_all
from layflat.app.reproduce.studies import DEMONSTRATION_SEED, ModelSpec
from layflat.app.support.errors import LayflatError
from layflat.app.support.progress import Progress
from layflat.app.support.provenance import capture_provenance
from layflat.app.workers.episode_pool import EpisodeConfig, process_pool
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import Episode
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy import model_io as model_files
from layflat.policy import registry
from layflat.policy.trained_model import TrainedModel
from layflat.sim.robots.registry import robot_spec

ATTEMPTS_EACH = 3
"""Times the wanted number of demonstrations that are tried before too many have failed."""


class ArtifactStore:
    """The folder's demonstrations, one session for each robot and cloth, and its models."""

    def __init__(self, out: Path, *, seed: int) -> None:
        self._out = out
        self._seed = seed

    def session_path(self, robot: str, cloth: str) -> Path:
        return self._out / "demonstrations" / f"{robot}-{cloth}.h5"

    def model_path(self, taught: ModelSpec) -> Path:
        return self._out / "models" / f"{taught.name}.npz"

    def prepare(self, wanted: Iterable[ModelSpec], progress: Progress, *, workers: int) -> None:
        """Make what is missing of the models and their demonstrations; ``progress`` is in a phase of its own."""
        missing = [taught for taught in dict.fromkeys(wanted) if not self.model_path(taught).exists()]
        most: dict[tuple[str, str], int] = {}
        for taught in missing:
            key = taught.robot, taught.cloth
            most[key] = max(most.get(key, 0), taught.demonstrations)
        for (robot, cloth), count in most.items():
            self._demonstrate(robot, cloth, count, progress, workers)
        self._learn(missing, progress, workers)

    def model(self, taught: ModelSpec) -> TrainedModel:
        return model_files.load(self.model_path(taught))

    def attempts(self, robot: str, cloth: str) -> list[Episode]:
        """Every recorded demonstration by seed, failures too; without images."""
        path = self.session_path(robot, cloth)
        if not (path.exists() or path.with_name(path.name + ".parts").exists()):
            return []
        with open_session(path) as session:
            return sorted(session.episodes(images=False), key=lambda episode: episode.seed)

    def demonstrations(self, robot: str, cloth: str, count: int) -> list[Episode]:
        """The first ``count`` successful demonstrations by seed, or as many as there are."""
        return [episode for episode in self.attempts(robot, cloth) if episode.outcome == "success"][:count]

    def _demonstrate(self, robot: str, cloth: str, count: int, progress: Progress, workers: int) -> None:
        """Record until ``count`` demonstrations have succeeded; failed ones stay on record and are not learned from."""
        path = self.session_path(robot, cloth)
        path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            there = self.attempts(robot, cloth)
            short = count - sum(episode.outcome == "success" for episode in there)
            if short <= 0:
                return
            if len(there) + short > ATTEMPTS_EACH * count:
                raise LayflatError(f"of {len(there)} demonstrations ({robot}, {cloth}) {short} too few ended flat")
            seeds = {episode.seed for episode in there}
            first = DEMONSTRATION_SEED + self._seed
            missing = [seed for seed in range(first, first + len(there) + short) if seed not in seeds]
            with SessionRecorder(path, robot=robot_spec(robot), cloth=cloth, descriptor=DEFAULT_DESCRIPTOR) as recorder:
                jobs = [EpisodeConfig(robot=robot, cloth=cloth, seed=seed) for seed in missing]
                progress.status(f"{len(jobs)} demonstrations, {robot}, {cloth}")
                lost = keep_all(jobs, recorder, progress, workers=workers, echo=False)
            if lost:
                raise LayflatError(f"a demonstration was lost: {lost[0].reason}; the same command goes on from here")

    def _learn(self, missing: Sequence[ModelSpec], progress: Progress, workers: int) -> None:
        """Train each model in a process of its own."""
        if not missing:
            return
        with process_pool(min(workers, len(missing))) as pool:
            futures = {
                taught: pool.schedule(_train, args=[self.session_path(taught.robot, taught.cloth), taught, self._seed])
                for taught in missing
            }
            for taught, future in futures.items():
                path = self.model_path(taught)
                path.parent.mkdir(parents=True, exist_ok=True)
                model_files.save(future.result(), path, force=True)
                progress.advance(status=f"learned {taught.name}")


def _train(path: Path, taught: ModelSpec, seed: int) -> TrainedModel:
    with open_session(path) as session:
        episodes = [session.episode(name, images=False) for name in session.select(outcome="success")]
    first = sorted(episodes, key=lambda episode: episode.seed)[: taught.demonstrations]
    with redirect_stdout(sys.stderr):
        return registry.train(taught.policy, first, seed=seed, provenance=capture_provenance())
