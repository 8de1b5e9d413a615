"""Episode index: one row for each episode of a session, with flags that name what a person should look at.

>>> with open_session("demos.h5") as session:
...     suspicious = [row for row in episode_index(session) if row.flags]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.data.format import schema
from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.structure_checks import camera_of, mesh_shape_of
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
LAID_M = 0.06
"""Height below which cloth counts as laid."""
TURNED_NORMAL = -0.5
"""Largest z of a unit normal that counts as turned over: 120 degrees."""
OUTSIDE_SHARE = 0.05
"""Share of the cloth's nodes outside the image above which it is out of view: 0.02 at most in a usual episode."""
IDLE_SHARE = 0.01
"""Largest share of the action limit with which a step counts as idle: 0.2 mm."""
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


@dataclass(frozen=True)
class _Measures:
    """Numbers from an episode's arrays that its flags depend on."""

    jerk: float
    idle_start: int
    idle_end: int
    turned: float | None
    outside: float | None


_KNOWN: dict[tuple[str, str], _Measures] = {}
"""Measures by identity and content of every episode that this process has read: arrays are read once."""


def episode_index(session: Session, names: Sequence[str] | None = None) -> tuple[EpisodeRow, ...]:
    """Return one row for each episode, in the order of ``names``, by default of the session.

    The first call in a process reads actions and final state of each episode (about 2 ms each), later ones only what
    is new: call it again after each edit or take.
    """
    infos = session.infos()
    chosen = session.names if names is None else tuple(names)
    contents = session.contents(chosen)
    first = {info.seed: name for name, info in reversed(infos.items())}
    return tuple(
        _row(name, infos[name], _measured(session, name, contents[name]), duplicate=first[infos[name].seed] != name)
        for name in chosen
    )


def flag_counts(rows: Sequence[EpisodeRow]) -> dict[Flag, tuple[str, ...]]:
    """Return the names of the flagged episodes by flag; only flags that some episode has."""
    found = {flag: tuple(row.name for row in rows if flag in row.flags) for flag in FLAGS}
    return {flag: names for flag, names in found.items() if names}


def jerk(actions: FloatArray) -> float:
    """Return the sum of changes of the action (T, A) over the sum of actions; 0 of a robot that stands still."""
    path = np.linalg.norm(actions, axis=1).sum()
    return float(np.linalg.norm(np.diff(actions, axis=0), axis=1).sum() / path) if path > 0 else 0.0


def idle_steps(actions: FloatArray) -> tuple[int, int]:
    """Return the number of idle steps before the first and after the last motion; ``actions`` (T, A) in -1..1."""
    moving = np.flatnonzero((np.abs(actions) > IDLE_SHARE).any(axis=1))
    return (int(moving[0]), len(actions) - 1 - int(moving[-1])) if len(moving) else (len(actions), len(actions))


def turned_share(nodes: FloatArray) -> float:
    """Return the share of the cloth's area that lies turned over; ``nodes`` (rows, columns, 3) m, free edge first."""
    a, b, c, d = nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]
    normals = np.concatenate([np.cross(b - a, c - a), np.cross(c - d, b - d)]).reshape(-1, 3)
    heights = np.concatenate([a + b + c, d + b + c])[..., 2].ravel() / 3
    areas = np.linalg.norm(normals, axis=1)
    turned = (normals[:, 2] < TURNED_NORMAL * areas) & (heights < LAID_M)
    return float(areas[turned].sum() / areas.sum()) if areas.sum() > 0 else 0.0


def outside_share(points: FloatArray, camera: CameraModel) -> float:
    """Return the share of ``points`` (N, 3) m that are not within the camera's image."""
    x, y, z = ((points - camera.cam_to_world[:3, 3]) @ camera.cam_to_world[:3, :3]).T
    depth = np.where(z > 0, z, np.inf)
    column, row = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
    seen = (z > 0) & (np.abs(column - (camera.width - 1) / 2) <= camera.width / 2)
    return float(1 - np.mean(seen & (np.abs(row - (camera.height - 1) / 2) <= camera.height / 2)))


def _measured(session: Session, name: str, content: str) -> _Measures:
    key = session.info(name).uid, content
    if key not in _KNOWN:
        truth = session.info(name).flat_area_final is not None
        session.check(name, (schema.ACTIONS, schema.FINAL_STATE) if truth else (schema.ACTIONS,))
        actions, attributes = session.array(name, schema.ACTIONS), session.attributes(name)
        turned = outside = None
        if truth:
            nodes = session.array(name, schema.FINAL_STATE).reshape(-1, 3)
            camera, shape = camera_of(attributes), mesh_shape_of(attributes)
            turned = None if shape is None else turned_share(nodes.reshape(*shape, 3))
            outside = None if camera is None else outside_share(nodes, camera)
        _KNOWN[key] = _Measures(jerk(actions), *idle_steps(actions), turned, outside)
    return _KNOWN[key]


def _row(name: str, info: DemoInfo, measured: _Measures, *, duplicate: bool) -> EpisodeRow:
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
