"""Best, typical and worst episodes of an evaluation: their frames, and films of some."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import partial
from typing import Any

import pandas as pd

from layflat.app.evaluation.paired import CONDITION
from layflat.app.media.episode_renderer import EpisodeRenderer, is_drawable
from layflat.app.media.frames import key_steps
from layflat.app.report.blocks import Block, FrameStrip, VideoBlock
from layflat.app.report.headline import UNDISTURBED
from layflat.app.report.policies import policies_of
from layflat.app.report.results_like import ResultsLike
from layflat.app.support.formatting import percent, ratio

EXAMPLES = ("best", "typical", "worst")
STRIP_FRAMES = 6
STRIP_WIDTH = 220
VIDEO_WIDTH = 480
FILMS = 6
"""Films on a page unless more are asked for: each takes some seconds and 400 kB."""


def example_rows(rows: pd.DataFrame, column: str = "contact_final") -> list[tuple[str, Mapping[str, Any]]]:
    """Return (name from EXAMPLES, row) by ``column``, the median as typical; each episode once."""
    known = rows[rows[column].notna() & ~rows["crashed"].astype(bool)].sort_values([column, "flat_area_final", "seed"])
    picks = {len(known) - 1: "best", len(known) // 2: "typical", 0: "worst"}
    return [(name, known.iloc[at].to_dict()) for at, name in picks.items()] if len(known) else []


def film_runs(rows: pd.DataFrame, most: int | None = FILMS, first: str = "") -> set[str]:
    """Return the runs that are filmed: at most ``most``, the worst and the typical ones of the policy ``first`` first.

    Disturbed episodes come before undisturbed ones. None: a film of every example.
    """
    found = [
        (policy != first, row["disturbance"] == UNDISTURBED, -EXAMPLES.index(name), row["run"])
        for _, part in rows.groupby(list(CONDITION), sort=False)
        for policy in policies_of(part)
        for name, row in example_rows(part[part["policy"] == policy])
        if most is None or name != "best"
    ]
    return {run for *_, run in sorted(found, key=lambda item: item[:3])[:most]}


def example_blocks(
    results: ResultsLike, renderer: EpisodeRenderer, rows: pd.DataFrame, films: Collection[str]
) -> Iterator[Block]:
    """Yield frames of the examples of each policy, then a film of each run in ``films``."""
    filmed = []
    for policy in policies_of(rows):
        for name, row in example_rows(rows[rows["policy"] == policy]):
            episode = results.episode(row["run"])
            if not is_drawable(episode):
                continue
            caption = (
                f"{name}: seed {row['seed']}, final contact {percent(row['contact_final'])}, flat area "
                f"{ratio(row['flat_area_final'])}, stopped by {row['stopped_by']}"
            )
            steps = key_steps(episode, STRIP_FRAMES)
            frames = renderer.frame_strip(episode, steps, STRIP_WIDTH)
            yield FrameStrip(frames=frames, policy=policy, caption=caption, run=row["run"])
            if row["run"] in films:
                (poster,) = renderer.frame_strip(episode, [steps[len(steps) // 2]], VIDEO_WIDTH)
                film = partial(renderer.camera_frames, episode, VIDEO_WIDTH)
                fps, run = 1.0 / episode.step_s, row["run"]
                filmed.append(
                    VideoBlock(frames=film, fps=fps, poster=poster.image, policy=policy, caption=caption, run=run)
                )
    yield from filmed
