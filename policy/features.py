"""Layout of the input of a learned policy.

Thesis, chapter 4-1-2: holder position, WORD and contact portion; the baseline takes the position only. Columns are in
natural units (m in the world, unit vector, 0..1); `FeatureLayout.scales` divides them before they enter a kernel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import Observation, Step
from layflat.policy.base import PolicyError

Frame: TypeAlias = Literal["cloth", "world"]
"""Coordinates of a model: of a cloth as large as the towel (`layflat.data.cloth_frame`), or the thesis's, of the
world."""
CLOTH, WORLD = get_args(Frame)
ObservationColumns: TypeAlias = Mapping[str, FloatArray]
"""Rows (T, ...) by attribute of Observation, flat as in a session's file."""

_WIDTHS = {"corner_positions": 6, "holder_position": 3, "word": 2, "contact_portion": 1}
_CLOTH_COLUMNS = {
    # WORD enters as perception gives it: (0, 0) where the wrinkles are below its noise floor. Its strength is not
    # multiplied in: the strength's unit belongs to one camera and one kernel, so a model would not survive either.
    "word_x": ("word", 0),
    "word_y": ("word", 1),
    "contact": ("contact_portion", 0),
}
"""Attribute of Observation, and index in its row."""

WORD_COLUMNS = ("word_x", "word_y")
INPUT_SETS: Mapping[str, tuple[str, ...]] = {
    "position": (),
    "position+contact": ("contact",),
    "position+word": WORD_COLUMNS,
    "all": (*WORD_COLUMNS, "contact"),
}
"""Columns that each set adds to the position; ``all`` is the thesis's proposed method, ``position`` its baseline."""

POSITION_SCALE_M = 0.1
_CLOTH_SCALES = {"word_x": 1.0, "word_y": 1.0, "contact": 0.2}
"""Equally important changes of each column, so that one length scale can serve metres, unit vectors and portions.

Constants, not the spread of the data: 1 then means the same in every model, and a column that hardly moved in the
demonstrations does not have its noise blown up. On a planar toy with a drag whose speed depends on contact (5
demonstrations) the held-out error in x was 1.04 mm a step, against 1.14 with standard deviations and 1.27 unscaled.
"""


@dataclass(frozen=True, kw_only=True)
class FeatureLayout:
    """The columns of a model's input, in order."""

    robot: RobotSpec
    names: tuple[str, ...]
    frame: Frame = "world"
    """Coordinates of positions and actions."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        if self.frame not in get_args(Frame):
            raise PolicyError(f"frame is {self.frame!r}; it must be cloth or world")
        known = columns_of(self.robot)
        unknown = [name for name in self.names if name not in known]
        if unknown:
            raise PolicyError(f"feature {unknown[0]!r} is unknown; robot {self.robot} has {', '.join(known)}")
        if not self.names or len(set(self.names)) != len(self.names):
            raise PolicyError(f"features are {self.names}; there must be at least one and none twice")

    @property
    def size(self) -> int:
        """Number of columns, D."""
        return len(self.names)

    @property
    def _sources(self) -> list[tuple[str, int]]:
        return [columns_of(self.robot)[name] for name in self.names]

    def vector(self, observation: Observation) -> FloatArray:
        """Return (D,) columns of one observation, in natural units."""
        return np.array([float(np.ravel(getattr(observation, key))[index]) for key, index in self._sources])

    def select(self, observations: ObservationColumns) -> FloatArray:
        """Return (T, D) columns of many observations, in natural units."""
        return np.column_stack([observations[key][:, index] for key, index in self._sources])

    def matrix(self, steps: Sequence[Step]) -> FloatArray:
        """Return (T, D) columns of the observation at the start of each step."""
        return self.select(observation_columns([step.observation for step in steps], observation_keys(self.robot)))

    def scales(self) -> FloatArray:
        """Return (D,) divisors of the columns for a kernel with one length scale for all (Eq. 4-6)."""
        return np.array([_CLOTH_SCALES.get(name, POSITION_SCALE_M) for name in self.names])


def columns_of(robot: RobotSpec) -> Mapping[str, tuple[str, int]]:
    """Return the source of every column of a layout: the coordinates that an action displaces, and the cloth's."""
    key = position_key(robot)
    return {axis.coordinate: (key, 3 * axis.point + axis.axis) for axis in robot.axes} | _CLOTH_COLUMNS


def position_key(robot: RobotSpec) -> str:
    """Return the attribute of Observation that holds the positions of the robot's points, see `RobotSpec.points`."""
    return "holder_position" if robot.n_points == 1 else "corner_positions"


def observation_keys(robot: RobotSpec) -> tuple[str, ...]:
    """Return the attributes of Observation that a layout may use."""
    return (position_key(robot), "word", "contact_portion")


def observation_columns(observations: Sequence[Observation], keys: Sequence[str]) -> ObservationColumns:
    """Return these attributes of observations as columns."""
    return {
        key: np.array([np.ravel(getattr(o, key)) for o in observations]).reshape(len(observations), _WIDTHS[key])
        for key in keys
    }


def input_set(robot: RobotSpec, name: str, frame: Frame = "world") -> FeatureLayout:
    """Return the layout of a named input set: position, position+contact, position+word or all."""
    if name not in INPUT_SETS:
        raise PolicyError(f"input set {name!r} is unknown; it must be one of {', '.join(INPUT_SETS)}")
    return FeatureLayout(robot=robot, names=robot.coordinates + INPUT_SETS[name], frame=frame)
