"""Demonstrations and models in a folder: made when something first needs them, and used again."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from contextlib import redirect_stdout
from pathlib import Path

from layflat.app.reproduce.studies import DEMONSTRATION_SEED, ModelSpec
from layflat.app.support.errors import LayflatError
from layflat.app.support.progress import Progress
from layflat.app.workers.process import process_pool
from layflat.app.workers.run_items import collect_items, demonstrations
from layflat.app.workers.sim_options import sim_config
from layflat.data.provenance import capture_provenance
from layflat.data.session.environment_recorder import recorder_for
from layflat.data.session.parts import part_files
from layflat.data.session.reader import open_session
from layflat.data.types import Episode
from layflat.policy import model_io, registry
from layflat.policy.features import WORLD
from layflat.policy.trained_model import TrainedModel

MAX_ATTEMPTS = 3
"""Attempts for each demonstration wanted, before too many have failed."""


class ArtifactStore:
    """One session of demonstrations for each robot and cloth, and a file for each model."""

    def __init__(self, out: Path, *, seed: int, conditions: Sequence[str] = ()) -> None:
        self._out = out
        self._seed = seed
        self._conditions = conditions

    def session_path(self, robot: str, cloth: str) -> Path:
        """Return the path of the session."""
        return self._out / "demonstrations" / f"{robot}-{cloth}.h5"

    def model_path(self, spec: ModelSpec) -> Path:
        """Return the path of the model's file."""
        return self._out / "models" / f"{spec.name}.npz"

    def model(self, spec: ModelSpec) -> TrainedModel:
        """Load a model that was built."""
        return model_io.load(self.model_path(spec))

    def attempts(self, robot: str, cloth: str) -> list[Episode]:
        """Return every recorded demonstration by seed, failures too; without images."""
        path = self.session_path(robot, cloth)
        if not (path.exists() or part_files(path)):  # after a crash there may be journals alone
            return []
        with open_session(path) as session:
            return sorted(session.episodes(images=False), key=lambda episode: episode.seed)

    def demonstrations(self, robot: str, cloth: str, count: int) -> list[Episode]:
        """Return the first ``count`` successful demonstrations by seed, or as many as there are."""
        return [episode for episode in self.attempts(robot, cloth) if episode.outcome == "success"][:count]

    def build(self, specs: Iterable[ModelSpec], progress: Progress, *, workers: int) -> None:
        """Record and train what is missing; ``progress`` is in a phase with an item for each model."""
        missing = [spec for spec in dict.fromkeys(specs) if not self.model_path(spec).exists()]
        for robot, cloth in dict.fromkeys((spec.robot, spec.cloth) for spec in missing):
            counts = [spec.demonstrations for spec in missing if (spec.robot, spec.cloth) == (robot, cloth)]
            progress.status(f"demonstrations, {robot}, {cloth}")
            self.record(robot, cloth, max(counts), progress, workers=workers)
        self.train(missing, progress, workers=workers)

    def record(self, robot: str, cloth: str, count: int, progress: Progress, *, workers: int) -> None:
        """Record until ``count`` demonstrations have succeeded; failed ones are kept, but not learned from."""
        path = self.session_path(robot, cloth)
        path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            recorded = self.attempts(robot, cloth)
            n_missing = count - sum(episode.outcome == "success" for episode in recorded)
            if n_missing <= 0:
                return
            if len(recorded) + n_missing > MAX_ATTEMPTS * count:
                raise LayflatError(
                    f"of {len(recorded)} demonstrations ({robot}, {cloth}) {n_missing} too few ended flat"
                )
            first = DEMONSTRATION_SEED + self._seed
            seeds = set(range(first, first + len(recorded) + n_missing)) - {episode.seed for episode in recorded}
            config = sim_config(self._conditions, robot=robot, cloth=cloth)
            with recorder_for(path, config.environment_spec()) as recorder:
                items = demonstrations(config, sorted(seeds))
                collected = collect_items(items, path.parent, progress, workers=workers, recorder=recorder)
            collected.check()

    def train(self, specs: Iterable[ModelSpec], progress: Progress, *, workers: int) -> None:
        """Train the models that do not exist yet, each in a process of its own; an item of ``progress`` each."""
        missing = [spec for spec in dict.fromkeys(specs) if not self.model_path(spec).exists()]
        if not missing:
            return
        with process_pool(min(workers, len(missing))) as pool:
            futures = {spec: pool.schedule(self._train, args=[spec]) for spec in missing}
            for spec, future in futures.items():
                path = self.model_path(spec)
                path.parent.mkdir(parents=True, exist_ok=True)
                model_io.save(progress.wait(future), path, force=True)
                progress.advance(status=f"trained {spec.name}")

    def _train(self, spec: ModelSpec) -> TrainedModel:
        episodes = self.demonstrations(spec.robot, spec.cloth, spec.demonstrations)
        with redirect_stdout(sys.stderr):  # GPy prints when it is interrupted; stdout is for results
            provenance = capture_provenance()
            return registry.train(spec.policy, episodes, seed=self._seed, provenance=provenance, frame=WORLD)
