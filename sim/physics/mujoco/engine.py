"""Engine: MuJoCo's model and data, and what they are compiled from.

MuJoCo compiles a model once, with all that is in it. So parts and holds are gathered here, compiled at the next step
(6 ms for a towel), and the parts carry their motion over. The whole state can be saved.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError
from layflat.sim.physics.mujoco.model_text import CLOTH, world_text

STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Part(Protocol):
    """A moving part of a world: the cloth, an arm."""

    text: str
    """Its bodies in MuJoCo's XML."""

    def enter(self, model: Any, data: Any) -> None:
        """Become a part of a newly compiled model, with the motion of now."""

    def apply_forces(self, data: Any) -> None:
        """Set the forces of the coming substep."""


@dataclass
class Holds:
    """The holders of the cloth, and the arm."""

    points: dict[int, list[float]] = field(default_factory=dict)
    """Positions of the kinematic points, m, by their keys."""
    point_nodes: dict[int, int] = field(default_factory=dict)
    """Nodes that they hold."""
    tool_nodes: dict[int, list[float]] = field(default_factory=dict)
    """Nodes on the arm, each with its place in the last link's frame, m."""
    loads_kg: dict[int, float] = field(default_factory=dict)
    """Masses of hands on nodes."""
    motors: tuple[FloatArray, FloatArray, FloatArray] | None = None
    """Angles, rad, speeds and torque limits of the arm's stiff motors."""


@dataclass(frozen=True)
class SavedEngine:
    """A state of the engine."""

    values: np.ndarray
    model: Any
    """Models are not changed after they are compiled, but for step and gravity."""
    holds: Holds


class Engine:
    """Owner of the model; one per world."""

    def __init__(self, table_friction: float) -> None:
        """``table_friction``: Coulomb's, of table and cloth."""
        self.holds = Holds()
        self.table_friction = table_friction
        self.parts: dict[str, Part] = {}
        self.gravity_m_s2 = (0.0, 0.0, 0.0)
        self.substep_s = 0.0
        self._model: Any = None
        self._data: Any = None
        self._stale = True

    def __deepcopy__(self, memo: object) -> Engine:
        return self

    def add(self, name: str, part: Part) -> None:
        """Add a part; there is one of each name."""
        if name in self.parts:
            raise SimError(f"a MuJoCo world holds one {name}; make another world for a second one")
        self.parts[name] = part
        self.changed()

    def changed(self) -> None:
        """Compile before the next step: something has come, is held or was let go."""
        self._stale = True

    def step(self) -> None:
        """Simulate one substep."""
        self._compile()
        data = self._data
        if self.holds.points:
            data.mocap_pos[:] = list(self.holds.points.values())
        for part in self.parts.values():
            part.apply_forces(data)
        mujoco.mj_step(self._model, data)

    def set_options(self) -> None:
        """Make gravity and step those of the model."""
        if self._model is not None:
            self._model.opt.timestep, self._model.opt.gravity[:] = self.substep_s, self.gravity_m_s2

    def _compile(self) -> None:
        if not self._stale:
            return
        holds = self.holds
        model = mujoco.MjModel.from_xml_string(
            world_text(
                parts=[part.text for part in self.parts.values()],
                table_friction=self.table_friction,
                points=list(holds.points),
                held=[
                    *((f"point{key}", node) for key, node in holds.point_nodes.items()),
                    *(("tool", node) for node in holds.tool_nodes),
                ],
            )
        )
        if holds.loads_kg:
            for node, kg in holds.loads_kg.items():
                model.body_mass[model.body(f"{CLOTH}_{node}").id] += kg
            mujoco.mj_setConst(model, mujoco.MjData(model))
        # Both anchors, of which the compiler makes the second of where the bodies are at rest.
        model.eq_data[:, :6] = 0.0
        for k, place in enumerate(holds.tool_nodes.values(), start=len(holds.point_nodes)):
            model.eq_data[k, :3] = place
        self._use(model)

    def _use(self, model: Any) -> None:
        data = mujoco.MjData(model)
        for part in self.parts.values():
            part.enter(model, data)
        self._model, self._data, self._stale = model, data, False
        self.set_options()

    def save(self) -> SavedEngine:
        """Return the whole state."""
        self._compile()
        values = np.empty(mujoco.mj_stateSize(self._model, int(STATE)))
        mujoco.mj_getState(self._model, self._data, values, int(STATE))
        return SavedEngine(values, self._model, copy.deepcopy(self.holds))

    def restore(self, state: SavedEngine) -> None:
        """Go on from a state, to the bit."""
        if state.model is not self._model:
            self._use(state.model)
        self.holds, self._stale = copy.deepcopy(state.holds), False
        mujoco.mj_setState(self._model, self._data, state.values, int(STATE))
        self.set_options()

    def close(self) -> None:
        """Free model and data."""
        self._model = self._data = None
        self._stale = True
