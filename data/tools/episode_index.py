"""Episode index: one row for each episode of a session, with flags that name what a person should look at.

>>> with open_session("demos.h5") as session:
...     suspicious = [row for row in episode_index(session) if row.flags]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.measures import Measures
from layflat.data.session.reader import Session
from layflat.data.types import FLAT_AREA, Outcome, StoppedBy

Flag: TypeAlias = Literal[
    "jerky", "folded", "out of view", "idle beginning", "idle end", "duplicate seed", "not flat although success"
]

JERKY = 0.5
"""Largest change of the action for each metre of motion: scripted and learned episodes have 0.07 to 0.17, a stick in
bursts 0.28 to 0.47, random actions more than 1."""
FOLDED_GAP = 0.1
"""Contact portion minus flat area above which cloth must lie on cloth: the camera counts what lies on its reverse."""
FOLDED_SHARE = 0.04
"""Share of the cloth that lies turned over: below 0.01 of a laid cloth, 0.08 or more with a folded corner."""
OUTSIDE_SHARE = 0.05
"""Share of the cloth's nodes outside the image above which it is out of view: 0.02 at most in a usual episode."""
IDLE_S = 2.0
"""Longest rest at the beginning or end: a scripted demonstrator waits 1.2 s until the cloth has settled."""

FLAGS: Mapping[Flag, str] = {
    "jerky": f"the action changes by more than {JERKY:.0%} of its size from step to step, on average",
    "folded": f"flat area more than {100 * FOLDED_GAP:.0f} points below contact, or more than {FOLDED_SHARE:.0%} of the"
    " cloth lies turned over at the end",
    "out of view": f"more than {OUTSIDE_SHARE:.0%} of the cloth is outside the camera's image at the end, so that its"
    " contact is not measured",
    "idle beginning": f"the robot stands still for more than {IDLE_S:g} s before its first motion",
    "idle end": f"the robot stands still for more than {IDLE_S:g} s after its last motion",
    "duplicate seed": "an earlier episode has the same seed, and so the same start",
    "not flat although success": f"labelled a success with a flat area below {FLAT_AREA:g} (without a mesh: contact)",
}
"""Definition of each flag in a sentence, for tables and tooltips. A flag is absent where its data are: a real robot has
no mesh, so `folded` and `out of view` are unknown there."""


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """One episode, with all edits applied."""

    name: str
    """demo_<int>."""
    seed: int
    source: str
    outcome: Outcome
    stopped_by: StoppedBy
    disturbance: str
    contact_start: float
    contact: float
    """Camera's contact portion at the end, 0..1."""
    flat_area: float | None
    """Signed flat area at the end; None without ground truth."""
    n_steps: int
    length_s: float
    """Simulated duration."""
    created_utc: str
    operator: str
    images: bool
    """Whether camera images were recorded."""
    note: str
    """Note of a person; empty where there is none."""
    flags: tuple[Flag, ...]
    """What is suspicious, in the order of `FLAGS`, which defines each."""


def episode_index(session: Session, names: Sequence[str] | None = None) -> tuple[EpisodeRow, ...]:
    """Return one row for each episode, in the order of ``names``, by default of the session.

    No array is read where the session's index has the measures, so that it can be called after each edit or take.
    """
    infos = session.infos()
    chosen = session.names if names is None else tuple(names)
    first = {info.seed: name for name, info in reversed(infos.items())}
    return tuple(
        _row(name, infos[name], session.measures(name), duplicate=first[infos[name].seed] != name) for name in chosen
    )


def flag_counts(rows: Sequence[EpisodeRow]) -> dict[Flag, tuple[str, ...]]:
    """Return the names of the flagged episodes by flag; only flags that some episode has."""
    found = {flag: tuple(row.name for row in rows if flag in row.flags) for flag in FLAGS}
    return {flag: names for flag, names in found.items() if names}


def _row(name: str, info: DemoInfo, measured: Measures, *, duplicate: bool) -> EpisodeRow:
    flat = info.flat_area_final
    there: dict[Flag, bool] = {
        "jerky": measured.jerk > JERKY,
        "folded": (flat is not None and info.contact_final - flat > FOLDED_GAP)
        or (measured.turned or 0.0) > FOLDED_SHARE,
        "out of view": (measured.outside or 0.0) > OUTSIDE_SHARE,
        "idle beginning": measured.idle_start * info.step_s > IDLE_S,
        "idle end": measured.idle_end * info.step_s > IDLE_S,
        "duplicate seed": duplicate,
        "not flat although success": info.success and (info.contact_final if flat is None else flat) < FLAT_AREA,
    }
    return EpisodeRow(
        name=name,
        seed=info.seed,
        source=info.source,
        outcome=info.outcome,
        stopped_by=info.stopped_by,
        disturbance=info.disturbance,
        contact_start=info.contact_start,
        contact=info.contact_final,
        flat_area=flat,
        n_steps=info.n_steps,
        length_s=info.duration_s,
        created_utc=info.created_utc,
        operator=info.operator,
        images=info.images,
        note=info.note,
        flags=tuple(flag for flag in FLAGS if there[flag]),
    )
