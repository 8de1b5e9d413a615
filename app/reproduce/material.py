"""What the pages of a reproduction are made of: results, models, demonstrations and pictures, read once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import pandas as pd

from app.batch.results import Results
from app.report.blocks import Block, Strip
from app.report.painter import Painter, drawable, key_ticks
from app.reproduce.studies import Size, Trial
from app.reproduce.trials import results_of, with_rounds
from app.reproduce.workshop import Workshop
from app.tables import percent, ratio
from data.types import Episode

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
class Shown:
    """What an experiment has to show."""

    blocks: tuple[Block, ...]
    claims: tuple[Claim, ...] = ()


class Material:
    """Reads what is asked for when it is asked for; trials that were not run have no rows."""

    def __init__(self, out: Path, size: Size, workshop: Workshop) -> None:
        self.size = size
        self.workshop = workshop
        self.painter = Painter()
        self._out = out
        self._results: dict[str, Results | None] = {}
        self._rows: dict[str, pd.DataFrame] = {}

    def __enter__(self) -> Material:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.painter.__exit__(kind, error, trace)

    def results(self, trial: Trial) -> Results | None:
        if trial.name not in self._results:
            self._results[trial.name] = results_of(trial, self._out)
        return self._results[trial.name]

    def rows(self, *trials: Trial) -> pd.DataFrame:
        """Rows of all of them, each disturbance told apart as in ``with_rounds``; empty where nothing was run."""
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
    ) -> Iterator[Strip]:
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
                yield Strip(frames=self._frames(episode), tag=policy, caption=_caption(row))

    def _frames(self, episode: Episode) -> tuple:
        return self.painter.strip(episode, key_ticks(episode, STRIP_FRAMES), STRIP_WIDTH)

    def _rows_of(self, trial: Trial) -> pd.DataFrame:
        if trial.name not in self._rows:
            results = self.results(trial)
            self._rows[trial.name] = pd.DataFrame() if results is None else with_rounds(results)
        return self._rows[trial.name]


def _caption(row: pd.Series) -> str:
    return (
        f"{row['task']}, {row['cloth']}, seed {row['seed']}: final contact {percent(row['contact_final'])}, "
        f"flat area {ratio(row['flat_area_final'])}, stopped by {row['stopped_by'].replace('_', ' ')}"
    )
