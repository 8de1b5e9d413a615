"""Results, models, demonstrations and pictures of a reproduction, each read once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from layflat.app.evaluation.results import EvaluationResults
from layflat.app.media.episode_renderer import EpisodeRenderer, is_drawable
from layflat.app.media.frames import key_steps
from layflat.app.report.blocks import Figure, FrameStrip
from layflat.app.report.charts import Curve, curve_of
from layflat.app.report.evaluation_page import contact_curves
from layflat.app.report.thesis_tables import with_outcomes
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.studies import ScaleConfig, Trial
from layflat.app.reproduce.trials import results_of
from layflat.app.support.formatting import percent, ratio
from layflat.app.support.phases import DisturbanceOutcome, disturbance_outcomes

STRIP_WIDTH = 220
STRIP_FRAMES = 10


@dataclass(frozen=True, kw_only=True)
class EpisodeDigest:
    """Part of an episode that tables and curves need; the episode itself is some hundred times larger."""

    curve: Curve
    outcomes: tuple[DisturbanceOutcome, ...]
    mesh_start: float
    """Contact of the mesh at the first step."""


class ExperimentResults:
    """Reads each trial and episode when it is first asked for; trials that were not run have no rows."""

    def __init__(self, out: Path, scale: ScaleConfig, store: ArtifactStore, renderer: EpisodeRenderer) -> None:
        self.scale = scale
        self.store = store
        self._out = out
        self._renderer = renderer
        self._results: dict[str, EvaluationResults | None] = {}
        self._rows: dict[str, pd.DataFrame] = {}
        self._digests: dict[tuple[str, str], EpisodeDigest] = {}

    def results(self, trial: Trial) -> EvaluationResults | None:
        """Return the evaluation of a trial, None where it was not run."""
        if trial.name not in self._results:
            self._results[trial.name] = results_of(trial, self._out)
        return self._results[trial.name]

    def digest(self, trial: Trial, run: str) -> EpisodeDigest:
        """Return the digest of an episode that did not crash."""
        key = trial.name, run
        if key not in self._digests:
            results = self.results(trial)
            if results is None:
                raise KeyError(f"{trial.name} was not run")
            episode = results.episode(run)
            self._digests[key] = EpisodeDigest(
                curve=curve_of(episode),
                outcomes=disturbance_outcomes(episode),
                mesh_start=episode.ground_truths()[0].contact_portion_true,
            )
        return self._digests[key]

    def rows(self, *trials: Trial) -> pd.DataFrame:
        """Return the rows of all trials with_outcomes and ``mesh_start``; empty where nothing was run."""
        known = [part for part in map(self._rows_of, trials) if len(part)]
        return pd.concat(known, ignore_index=True) if known else pd.DataFrame()

    def _rows_of(self, trial: Trial) -> pd.DataFrame:
        if trial.name not in self._rows:
            results = self.results(trial)
            rows = pd.DataFrame() if results is None else results.rows
            if len(rows):
                rows = with_outcomes(rows, lambda run: self.digest(trial, run).outcomes)
                crashed = rows["crashed"].astype(bool)
                rows["mesh_start"] = [
                    float("nan") if lost else self.digest(trial, run).mesh_start
                    for run, lost in zip(rows["run"], crashed, strict=True)
                ]
            self._rows[trial.name] = rows
        return self._rows[trial.name]

    def curves(self, trial: Trial, rows: pd.DataFrame) -> Figure:
        """Draw contact over time of the trial's episodes in ``rows``, by policy."""
        return contact_curves(rows, lambda run: self.digest(trial, run).curve)

    def strips(
        self, trial: Trial, policy: str, disturbance: str, pick: Callable[[pd.DataFrame], Sequence[int]] | None = None
    ) -> Iterator[FrameStrip]:
        """Yield frames of the policy's episode of the first seed, or of the positions that ``pick`` returns."""
        results = self.results(trial)
        if results is None:
            return
        rows = results.rows
        mine = rows[(rows["policy"] == policy) & (rows["disturbance"] == disturbance) & ~rows["crashed"].astype(bool)]
        mine = mine.sort_values("seed")
        for position in pick(mine) if pick is not None else range(min(len(mine), 1)):
            row = mine.iloc[position]
            episode = results.episode(row["run"])
            if is_drawable(episode):
                frames = self._renderer.frame_strip(episode, key_steps(episode, STRIP_FRAMES), STRIP_WIDTH)
                yield FrameStrip(frames=frames, policy=policy, caption=_caption(row))


def _caption(row: pd.Series) -> str:
    return (
        f"{row['robot']}, {row['cloth']}, seed {row['seed']}: final contact {percent(row['contact_final'])}, "
        f"flat area {ratio(row['flat_area_final'])}, stopped by {row['stopped_by'].replace('_', ' ')}"
    )
