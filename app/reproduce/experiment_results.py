"""What the pages of a reproduction are made of: results, models, demonstrations and pictures, read once."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pandas as pd

from layflat.app.evaluation.phases import DisturbanceOutcome, disturbance_outcomes
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.media.frames import Frame
from layflat.app.report.blocks import Block, Figure, FrameStrip
from layflat.app.report.charts import Curve, curve_of
from layflat.app.report.episode_renderer import EpisodeRenderer, drawable, key_steps
from layflat.app.report.evaluation import contact_curves
from layflat.app.report.tables import percent, ratio
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.studies import ScaleConfig, Trial
from layflat.app.reproduce.trials import results_of
from layflat.data.types import Episode

STRIP_WIDTH = 220
STRIP_FRAMES = 10
MISSING = "Not run yet; the same command goes on with it."


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What the thesis says, what came out here, and whether that agrees."""

    what: str
    source: str
    thesis: str
    ours: str
    holds: str
    """"yes", "no", "in part", or why nothing can be said."""


@dataclass(frozen=True, kw_only=True)
class ExperimentOutput:
    """What an experiment has to show."""

    blocks: tuple[Block, ...]
    claims: tuple[Claim, ...] = ()


@dataclass(frozen=True, kw_only=True)
class EpisodeDigest:
    """What tables and curves need of an episode; the episode itself is some hundred times larger."""

    curve: Curve
    disturbance_outcomes: tuple[DisturbanceOutcome, ...]
    mesh_start: float
    """Contact of the mesh at the first step."""


class ExperimentResults:
    """Reads what is asked for when it is asked for, and each episode once; trials that were not run have no rows."""

    def __init__(self, out: Path, size: ScaleConfig, workshop: ArtifactStore) -> None:
        self.size = size
        self.workshop = workshop
        self.painter = EpisodeRenderer()
        self._out = out
        self._results: dict[str, EvaluationResults | None] = {}
        self._rows: dict[str, pd.DataFrame] = {}
        self._digests: dict[tuple[str, str], EpisodeDigest] = {}

    def __enter__(self) -> ExperimentResults:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.painter.__exit__(kind, error, trace)

    def results(self, trial: Trial) -> EvaluationResults | None:
        if trial.name not in self._results:
            self._results[trial.name] = results_of(trial, self._out)
        return self._results[trial.name]

    def digest(self, trial: Trial, run: str) -> EpisodeDigest:
        """Of an episode that did not crash."""
        key = trial.name, run
        if key not in self._digests:
            results = self.results(trial)
            if results is None:
                raise KeyError(f"{trial.name} was not run")
            self._digests[key] = digest_of(results.episode(run))
        return self._digests[key]

    def curves(self, trial: Trial, rows: pd.DataFrame) -> Figure:
        """Contact over time of the trial's episodes in ``rows``, by policy."""
        return contact_curves(rows, lambda run: self.digest(trial, run).curve)

    def rows(self, *trials: Trial) -> pd.DataFrame:
        """Rows of all of them; empty where nothing was run.

        Besides the batch's columns ``mesh_start``, and of the K-th disturbance (from 1) ``disturbed_K`` and
        ``regained_K``. ``contact_disturbed`` and ``gain`` are means over an episode's disturbances, so that it counts
        once however often it was disturbed; NaN without one.
        """
        parts = [self._rows_of(trial) for trial in trials]
        known = [part for part in parts if len(part)]
        return pd.concat(known, ignore_index=True) if known else pd.DataFrame()

    def strips(
        self,
        trial: Trial,
        policy: str,
        disturbance: str,
        *,
        pick: Callable[[pd.DataFrame], Sequence[int]] | None = None,
    ) -> Iterator[FrameStrip]:
        """Frames of the policy's episode of the first seed, or of those at the places that ``pick`` names."""
        results = self.results(trial)
        if results is None:
            return
        rows = results.rows
        mine = rows[(rows["policy"] == policy) & (rows["disturbance"] == disturbance) & ~rows["crashed"].astype(bool)]
        mine = mine.sort_values("seed")
        for place in pick(mine) if pick is not None else range(min(len(mine), 1)):
            row = mine.iloc[place]
            episode = results.episode(row["run"])
            if drawable(episode):
                yield FrameStrip(frames=self._frames(episode), tag=policy, caption=_caption(row))

    def _frames(self, episode: Episode) -> tuple[Frame, ...]:
        return self.painter.frame_strip(episode, key_steps(episode, STRIP_FRAMES), STRIP_WIDTH)

    def _rows_of(self, trial: Trial) -> pd.DataFrame:
        if trial.name not in self._rows:
            results = self.results(trial)
            lines = () if results is None else results.rows.to_dict(orient="records")
            self._rows[trial.name] = pd.DataFrame([self._row(trial, line) for line in lines])
        return self._rows[trial.name]

    def _row(self, trial: Trial, line: dict[Hashable, Any]) -> dict[Hashable, Any]:
        if line["crashed"]:
            return line | {"gain": float("nan"), "mesh_start": float("nan")}
        digest = self.digest(trial, line["run"])
        found = digest.disturbance_outcomes
        row = line | {"gain": float("nan"), "mesh_start": digest.mesh_start}
        if found:
            row["gain"] = float(np.mean([each.regained for each in found]))
            row["contact_disturbed"] = float(np.mean([each.disturbed for each in found]))
        for k, each in enumerate(found, start=1):
            row |= {f"disturbed_{k}": each.disturbed, f"regained_{k}": each.regained}
        return row


def digest_of(episode: Episode) -> EpisodeDigest:
    """What is kept of an episode."""
    return EpisodeDigest(
        curve=curve_of(episode),
        disturbance_outcomes=disturbance_outcomes(episode),
        mesh_start=episode.ground_truths()[0].contact_portion_true,
    )


def _caption(row: pd.Series) -> str:
    return (
        f"{row['robot']}, {row['cloth']}, seed {row['seed']}: final contact {percent(row['contact_final'])}, "
        f"flat area {ratio(row['flat_area_final'])}, stopped by {row['stopped_by'].replace('_', ' ')}"
    )
