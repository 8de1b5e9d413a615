"""Disturbances: their kinds, their presets, and what is random about them.

Lengths are shares of the cloth's length and forces are multiples of its weight, so that one name means the same to a
towel and to a napkin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.disturbances.toml_fields import READERS, read_field
from layflat.sim.errors import SimError, look_up
from layflat.sim.physics.base import GRAVITY_M_S2, Vector

Kind: TypeAlias = Literal["none", "push", "pull", "lift-drop", "poke", "fold", "wind"]
Range: TypeAlias = tuple[float, float]
"""Least and greatest value of a uniform distribution."""
Waypoint: TypeAlias = tuple[float, float]
"""Shares of the cloth's length forward (along the heading) and up, from where the hands took hold."""


@dataclass(frozen=True, kw_only=True)
class DisturbanceSpec:
    """A disturbance by name; `sample` draws what is random about it."""

    name: str
    kind: Kind
    along: Range = (0.35, 0.65)
    """Centre of the patch as a share of the length: 0 the free edge, 1 the held edge."""
    across: Range = (0.3, 0.7)
    """Centre of the patch as a share of the width: 0 at +y, 1 at -y."""
    patch: tuple[int, int] = (3, 3)
    """Nodes along the length, across the width."""
    heading_deg: Range = (0.0, 0.0)
    """Direction of the path on the table: 0 is +x, towards the held edge; 90 is +y."""
    path: tuple[Waypoint, ...] = ()
    """Corners of the hands' path; the start is (0, 0)."""
    turn_deg: float = 0.0
    """Angle by which the hands turn together over their path, as a page is turned: the last goes over the others."""
    scale: Range = (1.0, 1.0)
    """Factor on the path, or on the wind."""
    either_side: bool = False
    """Mirrored at y = 0 in every other draw."""
    speed_m_s: float = 0.15
    """Speed of the hands' target along the path."""
    force_weights: float = 3.0
    """Greatest total force of the hands / weight of the cloth."""
    wind_m_s2: float = 0.0
    """Acceleration of the cloth by a wind, along the heading."""
    time_limit_s: float = 1.0
    """Greatest duration until the hands let go, or the wind ends."""
    settle_s: float = 1.0
    """Time from the end of the force until the disturbance counts as over."""

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise SimError(f"disturbance {self.name}: kind is {self.kind!r}; it must be one of {get_args(Kind)}")
        by_hand = self.kind not in ("none", "wind")
        rules = {
            **{field: (0 <= getattr(self, field)[0] <= getattr(self, field)[1] <= 1, "rise within 0..1")
               for field in ("along", "across")},
            **{field: (getattr(self, field)[0] <= getattr(self, field)[1], "rise")
               for field in ("heading_deg", "scale")},
            **{field: (getattr(self, field) > 0, "be above 0")
               for field in ("speed_m_s", "force_weights", "time_limit_s")},
            "patch": (min(self.patch) >= 1, "have a node each way"),
            "settle_s": (self.settle_s >= 0, "be at least 0"),
            "path": (bool(self.path) == by_hand, f"{'lead somewhere' if by_hand else 'be empty'} in a {self.kind}"),
            "turn_deg": (by_hand or not self.turn_deg, f"be 0 in a {self.kind}, which has no hands"),
            "wind_m_s2": ((self.wind_m_s2 != 0) == (self.kind == "wind"), "blow in a wind and in nothing else"),
        }  # fmt: skip
        for field, (valid, wanted) in rules.items():
            if not valid:
                raise SimError(f"disturbance {self.name}: {field} is {getattr(self, field)}; it must {wanted}")

    @staticmethod
    def from_mapping(values: Mapping[str, Any]) -> DisturbanceSpec:
        """Make a disturbance from plain values by field, as TOML has them; SimError for each that is wrong.

        ``like`` names a preset for the other fields; without it ``kind`` has to be given. A range is a list of two
        numbers, or one number where nothing is random; ``path`` is a list of [forward, up].
        """
        given = dict(values)
        name = given.pop("name", given.get("like"))
        if not isinstance(name, str) or not name:
            raise SimError(f"a disturbance's name is {name!r}; it must be a word")
        like = given.pop("like", None)
        unknown = sorted(set(given) - set(READERS))
        if unknown:
            known = ", ".join(("name", "like", *READERS))
            raise SimError(f"disturbance {name}: unknown field {unknown[0]!r}; the known ones are {known}")
        fresh = {field: read_field(name, field, value) for field, value in given.items()}
        if like is not None:
            if not isinstance(like, str):
                raise SimError(f"disturbance {name}: like is {like!r}; it must be the name of a disturbance")
            return replace(disturbance_spec(like), name=name, **fresh)
        if "kind" not in fresh:
            raise SimError(f"disturbance {name}: it has neither a kind nor a disturbance that it is like")
        return DisturbanceSpec(name=name, **fresh)

    def sample(self, rng: np.random.Generator, cloth: ClothSpec) -> DisturbanceTrajectory:
        """Draw what will happen to this cloth; the number of values drawn does not depend on the kind."""
        along, across = rng.uniform(*self.along), rng.uniform(*self.across)
        heading, scale = math.radians(rng.uniform(*self.heading_deg)), rng.uniform(*self.scale)
        if rng.uniform() < 0.5 and self.either_side:
            across, heading = 1.0 - across, -heading
        forward = np.array([math.cos(heading), math.sin(heading), 0.0])
        size = scale * cloth.length_m
        corners = [np.zeros(3), *(size * (ahead * forward + up * np.array([0.0, 0.0, 1.0])) for ahead, up in self.path)]
        wind = tuple((self.wind_m_s2 * scale * forward).tolist())
        turn = tuple((math.radians(self.turn_deg) * np.cross([0.0, 0.0, 1.0], forward)).tolist())
        return DisturbanceTrajectory(
            nodes=_patch_nodes(cloth, along, across, self.patch) if self.path else (),
            path_m=np.array(corners),
            turn_rad=turn,
            speed_m_s=self.speed_m_s,
            force_limit_n=self.force_weights * cloth.mass_kg * GRAVITY_M_S2,
            wind_m_s2=wind,
            time_limit_s=self.time_limit_s,
            settle_s=self.settle_s,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DisturbanceTrajectory:
    """A disturbance without anything random."""

    nodes: tuple[int, ...]
    """Cloth nodes of which hands take hold."""
    path_m: FloatArray
    """Corners of the path from where each hand took hold, (W, 3) m, world axes; the first is zero."""
    speed_m_s: float
    force_limit_n: float
    wind_m_s2: Vector
    time_limit_s: float
    settle_s: float
    turn_rad: Vector = (0.0, 0.0, 0.0)
    """Rotation vector, world axes, by which the hands have turned about their middle at the path's end."""

    @property
    def acts(self) -> bool:
        """Whether there is a force."""
        return bool(self.nodes) or any(self.wind_m_s2)

    def described(self) -> dict[str, Any]:
        """Return the fields as JSON values by name."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return values | {key: np.asarray(values[key]).tolist() for key in _ARRAYS}

    @staticmethod
    def recorded(described: Mapping[str, Any], cloth: ClothSpec) -> DisturbanceTrajectory:
        """Return the trajectory that was `described`; SimError where it does not fit this cloth."""
        try:
            values = {"turn_rad": (0.0, 0.0, 0.0)} | dict(described)
            wind, turn = (tuple(float(part) for part in values[key]) for key in ("wind_m_s2", "turn_rad"))
            path, nodes = np.array(values["path_m"], dtype=float), tuple(int(node) for node in values["nodes"])
            values |= {"nodes": nodes, "path_m": path, "wind_m_s2": wind, "turn_rad": turn}
            plan = DisturbanceTrajectory(**values)
            limits = (plan.speed_m_s, plan.force_limit_n, plan.time_limit_s, plan.settle_s)
            sound = path.ndim == 2 and path.shape[1] == len(wind) == len(turn) == 3
            sound = sound and bool(np.isfinite([*wind, *turn, *path.ravel(), *limits]).all())
        except (KeyError, TypeError, ValueError) as error:
            raise SimError(f"the recorded disturbance cannot be read by this version ({error})") from None
        if not sound or not all(0 <= node < cloth.n_nodes for node in nodes):
            raise SimError("the recorded disturbance does not fit this cloth: its nodes, path or numbers are invalid")
        return plan

    def target(self, time_s: float) -> tuple[FloatArray, FloatArray, bool]:
        """Return offset (3,) m and velocity (3,) m/s of the targets, and whether they are at the path's end."""
        left = self.speed_m_s * time_s
        for start, end in zip(self.path_m[:-1], self.path_m[1:], strict=True):
            length = float(np.linalg.norm(end - start))
            if left < length:
                forward = (end - start) / length
                return start + left * forward, self.speed_m_s * forward, False
            left -= length
        return self.path_m[-1], np.zeros(3), True

    def turned(self, time_s: float) -> FloatArray:
        """Return the rotation (3, 3) of the hands about their middle, which is even over the path."""
        length = float(np.linalg.norm(np.diff(self.path_m, axis=0), axis=1).sum())
        share = min(1.0, self.speed_m_s * time_s / length) if length > 0 else 1.0
        rotation: FloatArray = Rotation.from_rotvec(share * np.array(self.turn_rad)).as_matrix()
        return rotation


_ARRAYS = ("nodes", "path_m", "wind_m_s2", "turn_rad")


def _patch_nodes(cloth: ClothSpec, along: float, across: float, patch: tuple[int, int]) -> tuple[int, ...]:
    """Return the nodes of a patch around a place, moved into the cloth, without the held corners."""
    rows, columns = min(patch[0], cloth.rows), min(patch[1], cloth.columns)
    row = int(np.clip(round(along * (cloth.rows - 1)) - rows // 2, 0, cloth.rows - rows))
    column = int(np.clip(round(across * (cloth.columns - 1)) - columns // 2, 0, cloth.columns - columns))
    nodes = (i * cloth.columns + j for i in range(row, row + rows) for j in range(column, column + columns))
    return tuple(node for node in nodes if node not in cloth.corners)


NONE = DisturbanceSpec(name="none", kind="none", settle_s=0.0)

DISTURBANCES: Mapping[str, DisturbanceSpec] = {
    spec.name: spec
    for spec in (
        NONE,
        DisturbanceSpec(name="push", kind="push", path=((0.0, 0.03), (0.15, 0.03))),
        DisturbanceSpec(
            name="pull", kind="pull", along=(0.0, 0.3), heading_deg=(100.0, 170.0), path=((0.0, 0.03), (0.15, 0.03)),
        ),
        DisturbanceSpec(
            name="lift-drop", kind="lift-drop", along=(0.1, 0.4), path=((0.0, 0.2),), speed_m_s=0.3, force_weights=4.0
        ),
        DisturbanceSpec(
            name="poke", kind="poke", along=(0.15, 0.7), across=(0.15, 0.85), patch=(2, 2),
            heading_deg=(-90.0, 90.0), path=((0.12, 0.02),), speed_m_s=0.6, time_limit_s=0.4,
        ),
        DisturbanceSpec(name="wind", kind="wind", heading_deg=(60.0, 120.0), wind_m_s2=3.0, time_limit_s=0.5),
        DisturbanceSpec(
            name="gust-x", kind="wind", heading_deg=(-10.0, 10.0), wind_m_s2=8.0, scale=(1.0, 1.5), time_limit_s=0.5
        ),
        DisturbanceSpec(
            name="gust-y", kind="wind", heading_deg=(80.0, 100.0), wind_m_s2=8.0, scale=(1.4, 2.1), either_side=True,
            time_limit_s=0.5,
        ),
        DisturbanceSpec(
            name="tug", kind="pull", along=(0.0, 0.3), heading_deg=(30.0, 80.0), path=((0.0, 0.06), (0.25, 0.06)),
            scale=(0.8, 1.2), either_side=True,
        ),
        DisturbanceSpec(
            name="lift-aside", kind="lift-drop", along=(0.1, 0.4), heading_deg=(-45.0, 45.0),
            path=((0.0, 0.15), (0.12, 0.18)), scale=(0.8, 1.2), speed_m_s=0.3, force_weights=4.0, time_limit_s=2.0,
        ),
        DisturbanceSpec(
            name="fold-corner", kind="fold", along=(0.0, 0.0), across=(0.0, 0.0), patch=(2, 2),
            heading_deg=(-55.0, -35.0), path=((0.1, 0.16), (0.5, 0.16), (0.6, 0.04)), turn_deg=180.0, scale=(0.8, 1.1),
            either_side=True, speed_m_s=0.25, time_limit_s=2.0,
        ),
        DisturbanceSpec(
            name="fold-edge", kind="fold", along=(0.0, 0.0), across=(0.5, 0.5), patch=(1, 99),
            path=((0.1, 0.12), (0.4, 0.12), (0.5, 0.03)), scale=(0.8, 1.1), speed_m_s=0.25, time_limit_s=2.0,
        ),
        DisturbanceSpec(
            name="thesis", kind="push", along=(0.45, 0.65), across=(0.35, 0.65), heading_deg=(-15.0, 15.0),
            path=((0.02, 0.1), (0.15, 0.06)), scale=(0.64, 0.76), time_limit_s=0.8,
        ),
    )
}  # fmt: skip
"""Every disturbance by name; ``thesis`` is the stick of chapters 4-2-3 and 4-3-3."""


def disturbance_spec(name: str) -> DisturbanceSpec:
    """Return a preset; SimError lists the known names."""
    return look_up("disturbance", name, DISTURBANCES)
